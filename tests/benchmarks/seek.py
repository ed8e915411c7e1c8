"""Time to a random frame, beside H.264: `python -m tests.benchmarks.seek SOURCE FILE.gsvr`.

80 random frames of an opened file, each to an RGB array: ours by `decoder[i]`, H.264 by PyAV's
`seek` and decoding up to the frame. x264 (preset medium) has encoded the same frames at the PSNR of
the file, with its default distance of key frames, 250 at most, and with a key frame every 12;
libavcodec decodes with a thread a core, and with one thread, which answers sooner on small files.
Every round opens all files anew and asks all of them for the same frames. As a decoder of ours
keeps the GOPs it has seen, a second row gives the times of decoders that have seen none.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median
from types import TracebackType
from typing import Any, Self

import av
import click
import numpy as np

import gsvrcodec
from gsvrcodec.video import Rgb
from tests.benchmarks import x264
from tests.benchmarks.footage import read
from tests.benchmarks.machine import command, commit, machine

#: Random frames of a round.
REQUESTS = 80

KEYS = (None, 12)

OURS, OURS_COLD = "gsvr", "gsvr, no GOP in memory"


class AvFrames:
    """Frames of a video file by their number, through PyAV."""

    def __init__(self, path: Path, threads: int) -> None:
        """Open a file and learn the times of its frames; `threads` 0 = all cores."""
        with av.open(str(path)) as container:
            packets = container.demux(container.streams.video[0])
            self._pts = sorted(packet.pts for packet in packets if packet.pts is not None)
        self._container = av.open(str(path))
        self._stream = self._container.streams.video[0]
        self._rgb_of = x264.rgb_of()
        self._stream.thread_type, self._stream.thread_count = "AUTO", threads

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._container.close()

    def __len__(self) -> int:
        return len(self._pts)

    def __getitem__(self, index: int) -> Rgb:
        pts = self._pts[index]
        self._container.seek(pts, stream=self._stream)
        for frame in self._container.decode(self._stream):
            if frame.pts == pts:
                return self._rgb_of(frame)
        raise IndexError(index)


@dataclass(frozen=True, slots=True)
class Round:
    """Times of one round of requests, seconds."""

    median: float
    worst: float


def requests(frames: int, seed: int, count: int = REQUESTS) -> list[int]:
    """Return frame numbers to ask for, any of them as often as another."""
    return [int(index) for index in np.random.default_rng(seed).integers(0, frames, count)]


def timed(get: Callable[[int], object], indices: Sequence[int]) -> Round:
    """Measure how long each frame takes."""
    times = []
    for index in indices:
        start = time.perf_counter()
        get(index)
        times.append(time.perf_counter() - start)
    return Round(median(times), max(times))


def ours(path: Path, indices: Sequence[int], threads: int) -> Round:
    """Measure a .gsvr file, opened once."""
    with gsvrcodec.open(path, threads=threads) as decoder:
        return timed(decoder.__getitem__, indices)


def ours_cold(path: Path, indices: Sequence[int], threads: int) -> Round:
    """Measure a .gsvr file, opened anew for each frame; the opening is not in the times."""
    times = []
    for index in indices:
        with gsvrcodec.open(path, threads=threads) as decoder:
            times.append(timed(decoder.__getitem__, [index]).worst)
    return Round(median(times), max(times))


def theirs(path: Path, indices: Sequence[int], threads: int) -> Round:
    """Measure a video file of another codec."""
    with AvFrames(path, threads) as frames:
        return timed(frames.__getitem__, indices)


def usual(rounds: Sequence[Round]) -> Round:
    """Return the median of the rounds."""
    return Round(median(r.median for r in rounds), median(r.worst for r in rounds))


@click.command()
@click.argument("source", type=click.Path(path_type=Path, exists=True))
@click.argument("file", type=click.Path(path_type=Path, exists=True, dir_okay=False))
@click.option("--repeats", default=5, show_default=True, type=click.IntRange(min=1))
@click.option("--threads", default=os.cpu_count() or 1, show_default=True)
@click.option("--json", "output", type=click.Path(path_type=Path), help="Write all of it here.")
def main(source: Path, file: Path, repeats: int, threads: int, output: Path | None) -> None:
    """Compare random access to FILE with H.264 of the same frames of SOURCE."""
    footage, own = read(source, file)
    quality = footage.psnr(own.pictures(threads))
    encodes: dict[str, x264.Encode] = {}
    rounds: dict[str, list[Round]] = {OURS: [], OURS_COLD: []}
    counts = sorted({threads, 1}, reverse=True)
    with tempfile.TemporaryDirectory() as folder:
        for key in KEYS:
            name = x264.label(key)
            path = Path(folder) / f"key-{key}.mp4"
            encodes[name] = x264.match(footage, path, key, quality, "psnr")
            rounds |= {f"{name}, {_threads(count)}": [] for count in counts}
        for number in range(repeats):
            indices = requests(own.frames, number)
            rounds[OURS].append(ours(file, indices, threads))
            rounds[OURS_COLD].append(ours_cold(file, indices, threads))
            for name, encode in encodes.items():
                for count in counts:
                    found = theirs(encode.path, indices, count)
                    rounds[f"{name}, {_threads(count)}"].append(found)
    print(machine())
    print(
        f"{file.name}: {own.frames} frames of {footage.info.width}x{footage.info.height}, "
        f"{own.bpp:.4f} bpp, {quality:.2f} dB, {_threads(threads)}"
    )
    for name, encode in encodes.items():
        print(f"{name}: CRF {encode.crf:g}, {encode.bpp:.4f} bpp, {encode.psnr:.2f} dB")
    print(f"{'':32}{'median ms':>10}{'worst ms':>10}{'x ours':>9}{'worst':>8}")
    fixed = usual(rounds[OURS])
    for name, values in rounds.items():
        found = usual(values)
        print(
            f"{name:32}{1000 * found.median:10.2f}{1000 * found.worst:10.2f}"
            f"{found.median / fixed.median:9.2f}{found.worst / fixed.worst:8.2f}"
        )
    if output is not None:
        document: dict[str, Any] = {
            "machine": machine(),
            "commit": commit(),
            "load": os.getloadavg()[0],
            "command": command("tests.benchmarks.seek"),
            "source": source.name,
            "file": file.name,
            "frames": own.frames,
            "bpp": own.bpp,
            "psnr": quality,
            "threads": threads,
            "x264": {
                name: {"crf": encode.crf, "bpp": encode.bpp, "psnr": encode.psnr}
                for name, encode in encodes.items()
            },
            "seconds": {name: asdict(usual(values)) for name, values in rounds.items()},
            "rounds": {name: [asdict(r) for r in values] for name, values in rounds.items()},
        }
        output.write_text(json.dumps(document, indent=1) + "\n")


def _threads(count: int) -> str:
    return "1 thread" if count == 1 else f"{count} threads"


if __name__ == "__main__":
    sys.exit(main())
