"""Decoding speed beside H.264's: `python -m tests.benchmarks.decode FILE.gsvr SOURCE`.

The same frames are coded by x264 (preset medium) at the PSNR of the .gsvr file, and both files are
decoded to RGB in turns, several times, on the same cores. Prints medians: render only, bitstream
to RGB, file to mp4; and what one thread reaches.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from fractions import Fraction
from pathlib import Path
from statistics import fmean, median

import av
import click
import numpy as np
from numpy.typing import NDArray

import gsvrcodec
from gsvrcodec.decoder.gop_cache import GopCache
from gsvrcodec.metrics import psnr
from gsvrcodec.model.time import normalised_time
from gsvrcodec.render import backend_on
from gsvrcodec.video import open_video
from tests.benchmarks.machine import machine

Frames = Sequence[NDArray[np.uint8]]


def x264(frames: Frames, rate: Fraction, crf: float, path: Path) -> None:
    """Code frames as x264 does by default: preset medium, yuv420p."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=rate)
        stream.height, stream.width = frames[0].shape[:2]
        stream.pix_fmt = "yuv420p"
        stream.options = {"crf": str(crf), "preset": "medium"}
        for rgb in frames:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(rgb, format="rgb24")))
        container.mux(stream.encode(None))


def h264_frames(path: Path, threads: int) -> Iterator[NDArray[np.uint8]]:
    """Decode a file to RGB with libavcodec's frame and slice threads."""
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        stream.thread_type = "AUTO"
        stream.thread_count = threads
        for frame in container.decode(stream):
            yield np.asarray(frame.to_ndarray(format="rgb24"), np.uint8)


def gsvr_frames(path: Path, threads: int) -> Iterator[NDArray[np.uint8]]:
    """Decode a .gsvr file to RGB."""
    with gsvrcodec.open(path, threads=threads) as decoder:
        for frame in decoder:
            yield frame.data.astype(np.uint8, copy=False)


def drain(frames: Iterable[object]) -> None:
    """Take all frames and keep none."""
    deque(frames, maxlen=0)


def matching_crf(frames: Frames, rate: Fraction, wanted: float, path: Path) -> float:
    """Leave at `path` the file whose mean PSNR is nearest to `wanted`; return that PSNR."""
    low, high = 1.0, 51.0
    for _ in range(7):
        crf = (low + high) / 2
        x264(frames, rate, crf, path)
        reached = mean_psnr(frames, h264_frames(path, 0))
        low, high = (crf, high) if reached > wanted else (low, crf)
    return reached


def mean_psnr(frames: Frames, others: Iterable[NDArray[np.uint8]]) -> float:
    """Mean of the frames' PSNR, dB."""
    return fmean(psnr(a, b) for a, b in zip(frames, others, strict=True))


def rates(frames: int, repeats: int, *calls: Callable[[], object]) -> list[float]:
    """Median frames a second of each call, the calls taking turns."""
    times: list[list[float]] = [[] for _ in calls]
    for call in calls:
        call()
    for _ in range(repeats):
        for taken, call in zip(times, calls, strict=True):
            start = time.perf_counter()
            call()
            taken.append(time.perf_counter() - start)
    return [frames / median(taken) for taken in times]


def render_only(path: Path, threads: int) -> Callable[[], object]:
    """A call that renders all frames from GOPs unpacked before."""
    with gsvrcodec.open(path) as decoder:
        size = (decoder.metadata.width, decoder.metadata.height)
    backend = backend_on("cpu", threads)
    cache = GopCache(path, None, backend.prepare)
    gops = [cache.get(position) for position in range(len(cache.reader.gops))]
    cache.close()

    def call() -> None:
        for gop in gops:
            backend.render(gop.prepared, normalised_time(gop.pts), size, size)

    return call


@click.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.argument("source", type=click.Path(path_type=Path))
@click.option("--repeats", default=7, show_default=True)
@click.option("--threads", default=os.cpu_count() or 1, show_default=True)
def main(file: Path, source: Path, repeats: int, threads: int) -> None:
    """Compare decoding speed of FILE with H.264 of the same frames of SOURCE."""
    with gsvrcodec.open(file) as decoder:
        settings, rate = decoder.metadata.settings, decoder.metadata.average_rate
        count = len(decoder)
    crop = settings.get("crop")
    with open_video(source, tuple(crop) if crop else None, settings["start_frame"], count) as video:
        frames = [frame.rgb for frame in video]
    quality = mean_psnr(frames, gsvr_frames(file, threads))
    with tempfile.TemporaryDirectory() as folder:
        other = Path(folder) / "x264.mp4"
        reached = matching_crf(frames, rate or Fraction(25), quality, other)
        ours, theirs, rendered, ours_one, theirs_one = rates(
            count,
            repeats,
            lambda: drain(gsvr_frames(file, threads)),
            lambda: drain(h264_frames(other, threads)),
            render_only(file, threads),
            lambda: drain(gsvr_frames(file, 1)),
            lambda: drain(h264_frames(other, 1)),
        )
        mp4 = Path(folder) / "out.mp4"
        (to_mp4,) = rates(
            count, 1, lambda: gsvrcodec.decode(file, mp4, overwrite=True, threads=threads)
        )
        sizes = file.stat().st_size / 1000, other.stat().st_size / 1000
    print(machine())
    print(f"{count} frames of {frames[0].shape[1]}x{frames[0].shape[0]}, {threads} threads")
    print(f"{'':28}{'gsvr':>10}{'x264':>10}{'ratio':>8}")
    for name, own, other_value in (
        ("PSNR, dB", quality, reached),
        ("kB", *sizes),
        ("bitstream to RGB, fps", ours, theirs),
        ("  the same, one thread", ours_one, theirs_one),
    ):
        print(f"{name:28}{own:10.5g}{other_value:10.5g}{own / other_value:8.2f}")
    print(f"{'render only, fps':28}{rendered:10.5g}")
    print(f"{'file to mp4, fps':28}{to_mp4:10.5g}")
    print(f"{'threads over one thread':28}{ours / ours_one:10.2f}{theirs / theirs_one:10.2f}")


if __name__ == "__main__":
    sys.exit(main())
