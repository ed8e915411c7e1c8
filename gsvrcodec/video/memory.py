"""Frames from memory, checked and written to a lossless temporary file."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
from av.container import OutputContainer
from av.video.reformatter import ColorRange
from numpy.typing import NDArray

from gsvrcodec.errors import NotAVideoError, UsageError
from gsvrcodec.files import spooling
from gsvrcodec.video.colour import MATRIX_RGB, Rgb, to_rgb
from gsvrcodec.video.timing import Part


def write_frames(frames: Iterable[Any], rate: Fraction, part: Part, path: Path) -> None:
    """Write frames up to the end of a part as FFV1 in AVI: their RGB, a tick a frame.

    AVI keeps a time base of 1/rate, which Matroska and NUT do not.

    Args:
        frames: As of `rgb_frames`.
        rate: Frames a second.
        part: What will be read; frames after it are not asked for.
        path: The temporary file.

    Raises:
        NotAVideoError: There is no frame.
        OutputError: The temporary file cannot be written.
        UsageError: A frame cannot be encoded, or is not as large as those before.
    """
    tick, given, number = 1 / rate, 0, -1
    with _container(path) as container:
        stream = container.add_stream("ffv1", rate=rate, options={"level": "3", "slicecrc": "1"})
        for number, rgb in enumerate(rgb_frames(frames)):
            if number == 0:
                stream.height, stream.width, _ = rgb.shape
                stream.pix_fmt = "bgr0"
                stream.codec_context.colorspace = MATRIX_RGB
                stream.codec_context.color_range = ColorRange.JPEG
            frame = av.VideoFrame.from_ndarray(rgb, format="rgb24")
            frame.color_range = ColorRange.JPEG
            frame = frame.reformat(format="bgr0")
            frame.pts, frame.time_base = number, tick
            with _written(rgb):
                container.mux(stream.encode(frame))
            given += part.starts(number, number, tick)
            if part.ends(given, number + 1, tick):
                break
        if number < 0:
            raise NotAVideoError("there are no frames to encode")
        with _written(rgb):
            container.mux(stream.encode(None))


@contextmanager
def _container(path: Path) -> Iterator[OutputContainer]:
    """Open a file for writing, and close it after the block; what fails is an `OutputError`."""
    with spooling():
        container = av.open(f"file:{path}", "w", format="avi")
    try:
        yield container
    finally:
        with spooling():
            container.close()


@contextmanager
def _written(rgb: Rgb) -> Iterator[None]:
    """Turn an error of FFmpeg in the block, which writes a picture, into one of ours."""
    try:
        with spooling():
            yield
    except av.FFmpegError as error:
        height, width, _ = rgb.shape
        raise UsageError(
            f"frames of {width}x{height} cannot be encoded: {error.strerror}"
        ) from error


def rgb_frames(frames: Iterable[Any]) -> Iterator[Rgb]:
    """Yield frames as contiguous (H, W, 3) uint8 arrays, with one of them in memory.

    Args:
        frames: NumPy array or torch tensor (F, H, W, 3), or an iterable of (H, W, 3), on any
            device; uint8, or floating-point numbers from 0 to 1, which are rounded to 8 bits.
            Frames of PyAV are converted as those of a file.

    Raises:
        UsageError: Shape, type or a value is none of these, or the size of the frames changes.
    """
    shape = getattr(frames, "shape", None)
    if shape is not None and (len(shape) != 4 or shape[3] != 3):
        hint = "; `permute(0, 2, 3, 1)` puts channels last" if tuple(shape[1:2]) == (3,) else ""
        raise UsageError(f"frames must have the shape (F, H, W, 3), not {tuple(shape)}{hint}")
    first: tuple[int, ...] | None = None
    for number, frame in enumerate(frames):
        rgb = _rgb(frame, f"frame {number}")
        first = first or rgb.shape
        if rgb.shape != first:
            sizes = f"{rgb.shape[1]}x{rgb.shape[0]}, the ones before are {first[1]}x{first[0]}"
            raise UsageError(f"frames must be of one size: frame {number} is {sizes}")
        yield rgb


def _rgb(frame: Any, name: str) -> Rgb:
    """Return one frame as 8-bit RGB; `name` is for messages."""
    if isinstance(frame, av.VideoFrame):
        return np.ascontiguousarray(to_rgb(frame))
    if hasattr(frame, "detach"):  # a tensor, on whatever device
        frame = frame.detach().cpu()
    try:
        array = np.asarray(frame)
    except (TypeError, ValueError) as error:
        raise UsageError(f"{name} is neither an array nor a tensor: {error}") from error
    if array.ndim != 3 or array.shape[2] != 3 or not array.size:
        raise UsageError(f"{name} must have the shape (H, W, 3), not {array.shape}")
    if np.issubdtype(array.dtype, np.floating):
        return _rounded(array, name)
    if array.dtype != np.uint8:
        raise UsageError(
            f"{name} must be uint8, or floating-point numbers from 0 to 1, not {array.dtype}"
        )
    return np.ascontiguousarray(array, np.uint8)


def _rounded(values: NDArray[Any], name: str) -> Rgb:
    """Return samples from 0 to 1 in 8 bits."""
    if not np.all((values >= 0) & (values <= 1)):  # NaN is neither
        raise UsageError(f"{name} has values outside of 0 to 1, or NaN")
    return np.rint(255 * values.astype(np.float64)).astype(np.uint8)
