"""Presets at equal size: `python -m tests.benchmarks.presets CLIP... [--frames N]`.

Encodes the first frames of each clip with every preset at one number of `--crf`, and with preset
medium also around it. Prints by how much each preset is better than medium at the bits of its own
file, and the time that it takes; then the means over all clips.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
from typing import get_args

import click

from gsvrcodec.encoder.settings import Preset
from gsvrcodec.report.curve import RateCurve
from tests.benchmarks.bunny import pictures_of
from tests.benchmarks.encodes import Row, document, measure, save
from tests.benchmarks.machine import machine

#: Number that all presets are compared at, and those of medium around it.
NUMBER = 28.0
AROUND = (23.0, 33.0)


@dataclass(frozen=True, slots=True)
class Point:
    """A clip by a preset."""

    clip: str
    preset: str
    bpp: float
    psnr: float  #: dB
    seconds_per_frame: float
    gain: float  #: over medium at these bits, dB


@click.command()
@click.argument("clips", nargs=-1, required=True, type=click.Path(path_type=Path, exists=True))
@click.option("--frames", default=24, show_default=True, type=click.IntRange(min=2))
@click.option("--json", "output", type=click.Path(path_type=Path), help="Write all of it here.")
def main(clips: tuple[Path, ...], frames: int, output: Path | None) -> None:
    """Measure all presets on CLIPS."""
    print(machine())
    print(f"{'':24}{'preset':>9}{'bpp':>9}{'PSNR':>8}{'s/frame':>9}{'gain':>7}")
    points: list[Point] = []
    with tempfile.TemporaryDirectory() as folder:
        for clip in clips:
            for point in measured(clip, frames, Path(folder) / "a.gsvr"):
                points.append(point)
                print(line(point), flush=True)
    for preset in get_args(Preset):
        own = [point for point in points if point.preset == preset]
        seconds, gain = fmean(p.seconds_per_frame for p in own), fmean(p.gain for p in own)
        print(f"{'mean':24}{preset:>9}{'':9}{'':8}{seconds:9.2f}{gain:+7.2f}")
    if output is not None:
        common = {"crf": NUMBER, "frames": frames}
        save(output, document("tests.benchmarks.presets", common, points))


def measured(clip: Path, frames: int, path: Path) -> Iterator[Point]:
    """Yield a clip by each preset."""
    common = pictures_of(clip, frames)

    def encoded(preset: str, number: float) -> Row:
        return measure("presets", clip, path, {"preset": preset, "crf": number}, common)

    rows = {preset: encoded(preset, NUMBER) for preset in get_args(Preset)}
    medium = [rows["medium"], *(encoded("medium", number) for number in AROUND)]
    curve = RateCurve((row.psnr, row.bpp) for row in medium)
    for preset, row in rows.items():
        same = curve.quality_at(row.bpp)
        if same is None:
            sys.exit(f"{clip.name}: medium has no file as large as that of {preset}")
        gain = row.psnr - same
        yield Point(clip.name, preset, row.bpp, row.psnr, row.seconds_per_frame, gain)


def line(point: Point) -> str:
    """A row of the table."""
    figures = f"{point.bpp:9.4f}{point.psnr:8.2f}{point.seconds_per_frame:9.2f}{point.gain:+7.2f}"
    return f"{point.clip[:24]:24}{point.preset:>9}{figures}"


if __name__ == "__main__":
    sys.exit(main())
