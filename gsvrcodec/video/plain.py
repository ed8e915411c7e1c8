"""Writers without a container: Y4M, numbered PNG files, MD5, null."""

from __future__ import annotations

import hashlib
import logging
import sys
from pathlib import Path
from typing import BinaryIO, TextIO

import av
import numpy as np

from gsvrcodec.errors import UsageError
from gsvrcodec.video.colour import AnyRgb, to_ycbcr, ycbcr_format
from gsvrcodec.video.output import OutputInfo
from gsvrcodec.video.sequence import NUMBER

_log = logging.getLogger(__name__)

#: Y4M's name of a pixel format's chroma.
_Y4M_CHROMA = {
    "yuv420p": "420jpeg",
    "yuv444p": "444",
    "yuv420p10le": "420p10 XYSCSS=420P10",
    "yuv444p10le": "444p10 XYSCSS=444P10",
}


class Y4mWriter:
    """Uncompressed YCbCr, 4:2:0 or 4:4:4, at a constant frame rate."""

    def __init__(self, path: Path | None, info: OutputInfo) -> None:
        """Start the stream at `path`; None = standard output."""
        self._info = info
        self._format = ycbcr_format(info.width, info.height, info.bit_depth)
        self._file: BinaryIO = sys.stdout.buffer if path is None else path.open("wb")
        self._owned = path is not None
        self._warned = False
        rate, aspect = info.rate, info.sample_aspect
        levels = "FULL" if info.colour.full_range else "LIMITED"
        self._file.write(
            f"YUV4MPEG2 W{info.width} H{info.height} F{rate.numerator}:{rate.denominator} Ip "
            f"A{aspect.numerator}:{aspect.denominator} C{_Y4M_CHROMA[self._format]} "
            f"XCOLORRANGE={levels}\n".encode()
        )

    def write(self, rgb: AnyRgb, pts: int, duration: int) -> None:
        """Add one picture."""
        if not self._warned and duration * self._info.time_base * self._info.rate != 1:
            _log.warning(
                "the frame rate varies; .y4m has one rate only, use .mp4 to keep the times"
            )
            self._warned = True
        self._file.write(b"FRAME\n")
        for plane in to_ycbcr(rgb, self._format, self._info.colour).planes:
            line = plane.width * (2 if self._info.bit_depth > 8 else 1)
            lines = np.frombuffer(bytes(plane), np.uint8).reshape(plane.height, plane.line_size)
            self._file.write(lines[:, :line].tobytes())

    def close(self) -> None:
        """Finish the stream."""
        self._file.flush()
        self.abort()

    def abort(self) -> None:
        """Close the file."""
        if self._owned:
            self._file.close()


class PngWriter:
    """One PNG file a picture, named by its number in the film."""

    def __init__(self, path: Path | None, info: OutputInfo) -> None:
        """Write to the numbered names of the pattern `path`."""
        assert path is not None
        self._info = info
        self._paths = iter(png_paths(path, info))

    def write(self, rgb: AnyRgb, pts: int, duration: int) -> None:
        """Write one picture; its file appears only when complete."""
        target = next(self._paths)
        partial = target.with_name(f".{target.name}.part")
        try:
            partial.write_bytes(_png(rgb))
            partial.replace(target)
        finally:
            partial.unlink(missing_ok=True)

    def close(self) -> None:
        """Do nothing: every file is finished."""

    def abort(self) -> None:
        """Do nothing: what was written stays."""


class Md5Writer:
    """Prints the MD5 of all RGB bytes in order, to compare decoders."""

    def __init__(self, path: Path | None, info: OutputInfo) -> None:
        """Print the sum to `path` at the end; None = standard output."""
        self._file: TextIO = sys.stdout if path is None else path.open("w", encoding="ascii")
        self._owned = path is not None
        self._sum = hashlib.md5(usedforsecurity=False)

    def write(self, rgb: AnyRgb, pts: int, duration: int) -> None:
        """Add one picture to the sum."""
        self._sum.update(np.ascontiguousarray(rgb).data)

    def close(self) -> None:
        """Print the sum."""
        self._file.write(f"{self._sum.hexdigest()}\n")
        self._file.flush()
        self.abort()

    def abort(self) -> None:
        """Close the file."""
        if self._owned:
            self._file.close()


class NullWriter:
    """Discards all pictures, to measure decoding alone."""

    def __init__(self, path: Path | None, info: OutputInfo) -> None:
        """Nothing to open."""

    def write(self, rgb: AnyRgb, pts: int, duration: int) -> None:
        """Discard one picture."""

    def close(self) -> None:
        """Nothing to close."""

    def abort(self) -> None:
        """Nothing to close."""


def png_paths(path: Path, info: OutputInfo) -> list[Path]:
    """Return the path of every picture; the name in `path` has a number such as %04d.

    Raises:
        UsageError: The name has not exactly one number, and there are several pictures.
    """
    numbers = NUMBER.findall(path.name)
    if not numbers and info.frames == 1:
        return [path]
    if len(numbers) != 1 or path.name.count("%") != 1:
        raise UsageError(f"{path}: the name of a picture needs one number, as in out_%04d.png")
    first = info.first_frame
    return [path.with_name(path.name % n) for n in range(first, first + info.frames)]


def _png(rgb: AnyRgb) -> bytes:
    """Return a picture as a PNG file, with 16 bits a sample for pictures of more than 8 bits."""
    height, width = rgb.shape[:2]
    if rgb.dtype == np.uint16:
        deep = np.ascontiguousarray(rgb << 6 | rgb >> 4, np.uint16)
        frame = av.VideoFrame.from_ndarray(deep, format="rgb48le").reformat(format="rgb48be")
    else:
        frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(rgb, np.uint8), format="rgb24")
    encoder = av.CodecContext.create("png", "w")
    assert isinstance(encoder, av.VideoCodecContext)
    encoder.width, encoder.height, encoder.pix_fmt = width, height, frame.format.name
    return b"".join(bytes(packet) for packet in [*encoder.encode(frame), *encoder.encode(None)])
