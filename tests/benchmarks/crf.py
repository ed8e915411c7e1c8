"""Constant quality beside x264's: `python -m tests.benchmarks.crf CLIP... [--frames N]`.

Encodes the first frames of each clip at some numbers of `--crf`, and with x264 medium at the same
numbers. Prints bits a pixel and the mean PSNR of both, and the means over all clips.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
from typing import Any

import click

from gsvrcodec.video import open_video, reading_options
from tests.benchmarks import x264
from tests.benchmarks.bunny import pictures_of
from tests.benchmarks.clips import setting
from tests.benchmarks.encodes import document, measure, save
from tests.benchmarks.footage import Footage
from tests.benchmarks.machine import machine

NUMBERS = (20.0, 24.0, 28.0, 32.0, 36.0)


@dataclass(frozen=True, slots=True)
class Point:
    """A clip at a number."""

    clip: str
    crf: float
    bpp: float
    psnr: float  #: dB
    seconds_per_frame: float
    x264_bpp: float
    x264_psnr: float  #: dB


@click.command()
@click.argument("clips", nargs=-1, required=True, type=click.Path(path_type=Path, exists=True))
@click.option("--frames", default=48, show_default=True, type=click.IntRange(min=2))
@click.option("--crf", "numbers", multiple=True, type=float, default=NUMBERS, show_default=True)
@click.option("--set", "more", multiple=True, help="NAME=VALUE of all encodes, the value as JSON.")
@click.option("--json", "output", type=click.Path(path_type=Path), help="Write all of it here.")
def main(
    clips: tuple[Path, ...],
    frames: int,
    numbers: tuple[float, ...],
    more: tuple[str, ...],
    output: Path | None,
) -> None:
    """Measure CLIPS at some numbers."""
    added = dict(map(setting, more))
    print(machine())
    print(f"{'':24}{'crf':>5}{'bpp':>9}{'PSNR':>8}{'s/frame':>9}{'x264 bpp':>10}{'PSNR':>8}")
    points: list[Point] = []
    with tempfile.TemporaryDirectory() as temporary:
        for clip in clips:
            for point in measured(clip, numbers, frames, added, Path(temporary)):
                points.append(point)
                print(line(point), flush=True)
    for number in numbers:
        own = [point for point in points if point.crf == number]
        mine, theirs = fmean(p.psnr for p in own), fmean(p.x264_psnr for p in own)
        print(f"{'mean':24}{number:5g}{'':9}{mine:8.2f}{'':9}{'':10}{theirs:8.2f}")
    if output is not None:
        save(output, document("tests.benchmarks.crf", added | {"frames": frames}, points))


def measured(
    clip: Path, numbers: tuple[float, ...], frames: int, added: dict[str, Any], folder: Path
) -> Iterator[Point]:
    """Yield a clip at each number."""
    common = pictures_of(clip, frames)
    with open_video(clip, **reading_options(common)) as video:
        footage = Footage.of(video)
    for number in numbers:
        row = measure("crf", clip, folder / "a.gsvr", {"crf": number}, common | added)
        other = x264.encode(footage, folder / "a.mp4", number)
        yield Point(
            clip.name, number, row.bpp, row.psnr, row.seconds_per_frame, other.bpp, other.psnr
        )


def line(point: Point) -> str:
    """A row of the table."""
    ours = f"{point.bpp:9.4f}{point.psnr:8.2f}{point.seconds_per_frame:9.2f}"
    return f"{point.clip[:24]:24}{point.crf:5g}{ours}{point.x264_bpp:10.4f}{point.x264_psnr:8.2f}"


if __name__ == "__main__":
    sys.exit(main())
