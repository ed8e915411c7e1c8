"""What one gets without options: `python -m tests.benchmarks.defaults CLIP... [--frames N]`.

Encodes the first frames of each clip with the defaults. Prints bits a pixel, PSNR (mean, worst
frame, and where something moves, as `tests.benchmarks.moving` has it), MS-SSIM and seconds a frame.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import click

from gsvrcodec.metrics import ms_ssim_db
from tests.benchmarks.bunny import pictures_of
from tests.benchmarks.clips import setting
from tests.benchmarks.encodes import Row, document, measure, save
from tests.benchmarks.footage import read
from tests.benchmarks.machine import machine
from tests.benchmarks.moving import masks, point


@click.command()
@click.argument("clips", nargs=-1, required=True, type=click.Path(path_type=Path, exists=True))
@click.option("--frames", default=48, show_default=True, type=click.IntRange(min=2))
@click.option("--set", "more", multiple=True, help="NAME=VALUE of all encodes, the value as JSON.")
@click.option("--keep", type=click.Path(path_type=Path), help="Directory for the .gsvr files.")
@click.option("--json", "output", type=click.Path(path_type=Path), help="Write all of it here.")
def main(
    clips: tuple[Path, ...],
    frames: int,
    more: tuple[str, ...],
    keep: Path | None,
    output: Path | None,
) -> None:
    """Encode CLIPS with the defaults and measure the files."""
    added = dict(map(setting, more))
    print(machine())
    columns = ("bpp", "PSNR", "worst", "moving", "MS-SSIM", "s/frame")
    print(f"{'':32}" + "".join(f"{name:>8}" for name in columns))
    rows: list[Row] = []
    moving: dict[str, float | None] = {}
    with tempfile.TemporaryDirectory() as temporary:
        folder = keep or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        for clip in clips:
            path = folder / f"{clip.stem}.gsvr"
            row = measure("defaults", clip, path, added, pictures_of(clip, frames))
            rows.append(row)
            moving[clip.name] = psnr_of_moving(clip, path)
            print(line(row, moving[clip.name]), flush=True)
    if output is not None:
        content = document("tests.benchmarks.defaults", added | {"frames": frames}, rows)
        save(output, content | {"moving_psnr": moving})


def psnr_of_moving(clip: Path, path: Path) -> float | None:
    """PSNR of a file where something moves, dB; None = too little moves."""
    footage, ours = read(clip, path)
    areas = masks(footage.pictures)
    if not any(mask is not None for mask in areas):
        return None
    return point(ours.bpp, footage, areas, ours.pictures()).moving


def line(row: Row, moving: float | None) -> str:
    """A row of the table."""
    similar = None if row.ms_ssim is None else ms_ssim_db(row.ms_ssim)
    figures = f"{row.bpp:8.4f}{row.psnr:8.2f}{row.psnr_min:8.2f}{_number(moving)}"
    return f"{row.clip[:32]:32}{figures}{_number(similar)}{row.seconds_per_frame:8.2f}"


def _number(value: float | None) -> str:
    return f"{'-':>8}" if value is None else f"{value:8.2f}"


if __name__ == "__main__":
    sys.exit(main())
