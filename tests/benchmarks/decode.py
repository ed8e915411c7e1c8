"""Decoding speed beside H.264's: `python -m tests.benchmarks.decode FILE.gsvr SOURCE`.

The same frames are coded by x264 (preset medium) at the PSNR of the .gsvr file, and both files are
decoded to RGB in turns, several times, on the same cores. Prints medians: render only, bitstream
to RGB, file to mp4; and what one thread reaches. The ratio is the median of the rounds' ratios,
with the least and the greatest of them.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median

import click

import gsvrcodec
from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.decoder.gop_cache import GopCache
from gsvrcodec.limits import Limits
from gsvrcodec.model.time import normalised_time
from gsvrcodec.render import backend_on
from gsvrcodec.render.order import arranged
from tests.benchmarks import x264
from tests.benchmarks.footage import read
from tests.benchmarks.machine import command, commit, machine


@dataclass(frozen=True, slots=True)
class Ratio:
    """How many times faster ours is, over the rounds."""

    median: float
    least: float
    greatest: float

    @classmethod
    def of(cls, ours: Sequence[float], theirs: Sequence[float]) -> Ratio:
        """Compare seconds of the same rounds."""
        ratios = [other / own for own, other in zip(ours, theirs, strict=True)]
        return cls(median(ratios), min(ratios), max(ratios))


def drain(frames: Iterable[object]) -> None:
    """Take all frames and keep none."""
    deque(frames, maxlen=0)


def seconds(repeats: int, *calls: Callable[[], object]) -> list[list[float]]:
    """Return the seconds that each call took in each round, the calls taking turns."""
    times: list[list[float]] = [[] for _ in calls]
    for call in calls:
        call()
    for _ in range(repeats):
        for taken, call in zip(times, calls, strict=True):
            start = time.perf_counter()
            call()
            taken.append(time.perf_counter() - start)
    return times


def render_only(path: Path, threads: int) -> Callable[[], object]:
    """A call that renders all frames from GOPs unpacked before."""
    with gsvrcodec.open(path) as decoder:
        size = (decoder.metadata.width, decoder.metadata.height)
    backend = backend_on("cpu", threads)
    reader = GsvrReader(path)
    cache = GopCache(reader, Limits(), lambda gop: backend.prepare(arranged(gop, size)))
    gops = [cache.get(position) for position in range(len(reader.gops))]
    cache.close()

    def call() -> None:
        for gop in gops:
            backend.render(gop.prepared, normalised_time(gop.pts), size, size)

    return call


@click.command()
@click.argument("file", type=click.Path(path_type=Path, exists=True, dir_okay=False))
@click.argument("source", type=click.Path(path_type=Path, exists=True))
@click.option("--repeats", default=7, show_default=True, type=click.IntRange(min=1))
@click.option("--threads", default=os.cpu_count() or 1, show_default=True)
@click.option("--json", "output", type=click.Path(path_type=Path), help="Write all of it here.")
def main(file: Path, source: Path, repeats: int, threads: int, output: Path | None) -> None:
    """Compare decoding speed of FILE with H.264 of the same frames of SOURCE."""
    footage, own = read(source, file)
    count, size = own.frames, (footage.info.width, footage.info.height)
    quality = footage.psnr(own.pictures(threads))
    with tempfile.TemporaryDirectory() as folder:
        other = x264.match(footage, Path(folder) / "x264.mp4", None, quality, "psnr")
        calls = {
            "ours": lambda: drain(own.pictures(threads)),
            "theirs": lambda: drain(other.pictures(threads)),
            "render_only": render_only(file, threads),
            "ours_one_thread": lambda: drain(own.pictures(1)),
            "theirs_one_thread": lambda: drain(other.pictures(1)),
        }
        taken = dict(zip(calls, seconds(repeats, *calls.values()), strict=True))
        mp4 = Path(folder) / "out.mp4"
        (taken["to_mp4"],) = seconds(
            1, lambda: gsvrcodec.decode(file, mp4, overwrite=True, threads=threads)
        )
    fps = {name: count / median(values) for name, values in taken.items()}
    ratios = {
        "bitstream to RGB, fps": ("", Ratio.of(taken["ours"], taken["theirs"])),
        "  the same, one thread": (
            "_one_thread",
            Ratio.of(taken["ours_one_thread"], taken["theirs_one_thread"]),
        ),
    }
    print(machine())
    print(f"{file.name}: {count} frames of {size[0]}x{size[1]}, {threads} threads")
    print(f"{'':28}{'gsvr':>10}{'x264':>10}{'ratio':>8}   of {repeats} rounds")
    for name, ours, theirs in (("PSNR, dB", quality, other.psnr), ("bpp", own.bpp, other.bpp)):
        print(f"{name:28}{ours:10.5g}{theirs:10.5g}{ours / theirs:8.2f}")
    for name, (ending, ratio) in ratios.items():
        print(
            f"{name:28}{fps[f'ours{ending}']:10.5g}{fps[f'theirs{ending}']:10.5g}"
            f"{ratio.median:8.2f}   {ratio.least:.2f} to {ratio.greatest:.2f}"
        )
    print(f"{'render only, fps':28}{fps['render_only']:10.5g}")
    print(f"{'file to mp4, fps':28}{fps['to_mp4']:10.5g}")
    own_gain, other_gain = (fps[name] / fps[f"{name}_one_thread"] for name in ("ours", "theirs"))
    print(f"{'threads over one thread':28}{own_gain:10.2f}{other_gain:10.2f}")
    if output is not None:
        document = {
            "machine": machine(),
            "commit": commit(),
            "load": os.getloadavg()[0],
            "command": command("tests.benchmarks.decode"),
            "source": source.name,
            "file": file.name,
            "size": size,
            "frames": count,
            "bpp": own.bpp,
            "psnr": quality,
            "threads": threads,
            "x264": {"crf": other.crf, "bpp": other.bpp, "psnr": other.psnr},
            "fps": fps,
            "ratios": {name.strip(): asdict(ratio) for name, (_, ratio) in ratios.items()},
            "seconds": taken,
        }
        output.write_text(json.dumps(document, indent=1) + "\n")


if __name__ == "__main__":
    sys.exit(main())
