"""Lossless codecs for frames that travel: `python -m tests.benchmarks.packing CLIP ...`.

Prints ratio, and milliseconds a frame on one thread to pack and to unpack.
"""

from __future__ import annotations

import io
import time
from collections.abc import Callable
from itertools import islice
from pathlib import Path
from typing import Any

import av
import click
import imagecodecs
import numpy as np
from numpy.typing import NDArray

from gsvrcodec.video import open_video
from tests.benchmarks.machine import machine

Rgb = NDArray[np.uint8]
Codec = tuple[Callable[[Rgb], list[bytes]], Callable[[list[bytes], Rgb], Rgb]]


def each(encode: Callable[[Any], bytes | bytearray], decode: Callable[[bytes], Any]) -> Codec:
    """A codec of single pictures."""
    return (
        lambda clip: [bytes(encode(picture)) for picture in clip],
        lambda data, _: np.stack([decode(one) for one in data]),
    )


def differences(level: int) -> Codec:
    """Zstandard of differences in time, by plane: green, red and blue less green."""

    def pack(clip: Rgb) -> list[bytes]:
        change = clip.copy()
        change[1:] -= clip[:-1]
        change[..., 0] -= change[..., 1]
        change[..., 2] -= change[..., 1]
        planes = np.ascontiguousarray(np.moveaxis(change, -1, 1))
        return [bytes(imagecodecs.zstd_encode(planes.tobytes(), level=level))]

    def unpack(data: list[bytes], like: Rgb) -> Rgb:
        frames, height, width, _ = like.shape
        planes = np.frombuffer(imagecodecs.zstd_decode(data[0]), np.uint8)
        change = np.moveaxis(planes.reshape(frames, 3, height, width), 1, -1).copy()
        change[..., 0] += change[..., 1]
        change[..., 2] += change[..., 1]
        return np.add.accumulate(change, dtype=np.uint8)

    return pack, unpack


def video(name: str, pixels: str, options: dict[str, str]) -> Codec:
    """A video codec of FFmpeg's, on one thread."""

    def pack(clip: Rgb) -> list[bytes]:
        file = io.BytesIO()
        with av.open(file, "w", format="matroska") as container:
            stream: Any = container.add_stream(name, rate=25, options=options)
            stream.width, stream.height, stream.pix_fmt = clip.shape[2], clip.shape[1], pixels
            stream.thread_count = 1
            for picture in clip:
                frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
                container.mux(stream.encode(frame.reformat(format=pixels)))
            container.mux(stream.encode(None))
        return [file.getvalue()]

    def unpack(data: list[bytes], _: Rgb) -> Rgb:
        with av.open(io.BytesIO(data[0]), "r") as container:
            container.streams.video[0].thread_count = 1
            frames = container.decode(video=0)
            return np.stack([frame.to_ndarray(format="rgb24") for frame in frames])

    return pack, unpack


CODECS: dict[str, Codec] = {
    "JPEG XL, effort 1": each(
        lambda picture: imagecodecs.jpegxl_encode(picture, lossless=True, effort=1, numthreads=1),
        lambda data: imagecodecs.jpegxl_decode(data, numthreads=1),
    ),
    "zstd 1 of differences": differences(1),
    "zstd 3 of differences": differences(3),
    "QOI": each(imagecodecs.qoi_encode, imagecodecs.qoi_decode),
    "PNG, level 1": each(lambda p: imagecodecs.png_encode(p, level=1), imagecodecs.png_decode),
    "JPEG-LS": each(imagecodecs.jpegls_encode, imagecodecs.jpegls_decode),
    "x264 RGB, ultrafast": video("libx264rgb", "rgb24", {"qp": "0", "preset": "ultrafast"}),
    "FFV1": video("ffv1", "bgr0", {"level": "3", "coder": "0", "context": "0"}),
}


@click.command()
@click.argument("clips", nargs=-1, required=True)
@click.option("--frames", default=16, show_default=True, type=click.IntRange(min=1))
def main(clips: tuple[str, ...], frames: int) -> None:
    """Measure all codecs on the first frames of some clips."""
    print(machine())
    for path in clips:
        with open_video(path) as source:
            clip = np.stack([frame.rgb for frame in islice(source, frames)])
        print(f"{Path(path).name}, {clip.shape[2]}x{clip.shape[1]}, {len(clip)} frames")
        for name, (pack, unpack) in CODECS.items():
            began = time.perf_counter()
            data = pack(clip)
            between = time.perf_counter()
            same = np.array_equal(unpack(data, clip), clip)
            ended = time.perf_counter()
            ratio = clip.nbytes / sum(map(len, data))
            spans = [1e3 * span / len(clip) for span in (between - began, ended - between)]
            print(
                f"  {name:22} {ratio:5.2f} to 1, {spans[0]:5.1f} ms to pack, "
                f"{spans[1]:5.1f} ms to unpack{'' if same else ', NOT LOSSLESS'}"
            )


if __name__ == "__main__":
    main()
