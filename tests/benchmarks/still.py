"""Temporal noise of still areas: `python -m tests.benchmarks.still CLIP... [--set NAME=VALUE]`.

Encodes the first frames of clips from a locked camera. A pixel is still if it moves in no frame, as
`tests.benchmarks.moving` has it. Over those pixels the table has

* the variance of the luma over all frames, mean of the pixels, decoded over source: above 1 the
  codec adds noise, below 1 it takes noise away;
* the mean squared difference of successive frames, decoded over source, where a GOP begins and
  within GOPs: what jumps from GOP to GOP is seen as a flicker.

`--strip FILE.png` draws, for the last clip, the most varied still row of pixels over time: the
source above, decoded below.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean

import click
import cv2
import numpy as np
from numpy.typing import NDArray

import gsvrcodec
from gsvrcodec.metrics import luma
from gsvrcodec.video import Rgb
from tests.benchmarks.bunny import pictures_of
from tests.benchmarks.clips import setting
from tests.benchmarks.encodes import document, save
from tests.benchmarks.footage import read
from tests.benchmarks.machine import machine
from tests.benchmarks.moving import Mask, median_picture, moving

#: Pixels of a strip across, and times that it is enlarged.
_STRIP = (200, 3)


@dataclass(frozen=True, slots=True)
class Noise:
    """Temporal noise of an encode in still areas."""

    clip: str
    share: float  #: of the pixels that are still
    bpp: float
    psnr: float  #: dB, mean of the frames
    source: float  #: variance in the source, squared 8-bit codes
    variance: float  #: decoded over source
    within: float  #: squared difference of successive frames of one GOP, decoded over source
    between: float | None  #: the same for the last frame of a GOP and the first of the next


def lumas(pictures: Sequence[Rgb]) -> NDArray[np.float32]:
    """Return the luma of pictures, (F, H, W), 8-bit codes."""
    return np.stack([luma(picture) for picture in pictures])


def still_pixels(pictures: Sequence[Rgb]) -> Mask:
    """Return which pixels move in no picture, (H, W)."""
    still = median_picture(pictures)
    moved: Mask = np.any([moving(picture, still) for picture in pictures], axis=0)
    return ~moved


def noise(
    source: NDArray[np.float32], coded: NDArray[np.float32], still: Mask, starts: Sequence[int]
) -> tuple[float, float, float, float | None]:
    """Measure still areas.

    Args:
        source: (F, H, W) luma.
        coded: The same, decoded.
        still: (H, W) pixels to look at.
        starts: First frames of GOPs.

    Returns:
        Variance in the source, and `variance`, `within` and `between` of `Noise`.
    """
    inside, decoded = source[:, still], coded[:, still]
    own = float(inside.var(axis=0).mean())
    jumps, others = (np.square(np.diff(film, axis=0)).mean(axis=1) for film in (decoded, inside))
    at_start = np.isin(np.arange(1, len(source)), starts)
    between = float(jumps[at_start].mean() / others[at_start].mean()) if at_start.any() else None
    within = float(jumps[~at_start].mean() / others[~at_start].mean())
    return own, float(decoded.var(axis=0).mean()) / own, within, between


def strip(
    source: NDArray[np.float32], coded: NDArray[np.float32], still: Mask
) -> NDArray[np.uint8]:
    """Draw a row of still pixels over time, from top to bottom: source, a line, decoded."""
    across, times = _STRIP
    across = min(across, still.shape[1])
    whole = cv2.boxFilter(still.astype(np.float32), -1, (across, 1), anchor=(0, 0))
    varied = cv2.boxFilter(source.var(axis=0), -1, (across, 1), anchor=(0, 0))
    fits = (whole > 0.99) & (np.arange(still.shape[1]) <= still.shape[1] - across)
    if not fits.any():
        fits = whole == whole[:, : still.shape[1] - across + 1].max()
    y, x = np.unravel_index(np.where(fits, varied, -1).argmax(), still.shape)
    rows = [film[:, y, x : x + across] for film in (source, coded)]
    line = np.full((2, across), 255, np.float32)
    picture = np.concatenate([rows[0], line, rows[1]]).round().clip(0, 255).astype(np.uint8)
    return np.asarray(
        cv2.resize(picture, None, fx=times, fy=times, interpolation=cv2.INTER_NEAREST), np.uint8
    )


@click.command()
@click.argument("clips", nargs=-1, required=True, type=click.Path(path_type=Path, exists=True))
@click.option("--frames", default=96, show_default=True, type=click.IntRange(min=2))
@click.option("--set", "more", multiple=True, help="NAME=VALUE of all encodes, the value as JSON.")
@click.option("--strip", "drawn", type=click.Path(path_type=Path), help="Draw the last clip here.")
@click.option("--json", "output", type=click.Path(path_type=Path), help="Write all of it here.")
def main(
    clips: tuple[Path, ...],
    frames: int,
    more: tuple[str, ...],
    drawn: Path | None,
    output: Path | None,
) -> None:
    """Encode CLIPS and measure what their still areas do."""
    added = dict(map(setting, more))
    print(machine())
    print(f"{'':28}{'still':>7}{'bpp':>8}{'PSNR':>7}{'variance':>9}{'within':>8}{'between':>8}")
    rows = []
    for clip in clips:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "a.gsvr"
            result = gsvrcodec.encode(clip, path, **(pictures_of(clip, frames) | added))
            footage, ours = read(clip, path)
            coded = lumas(list(ours.pictures()))
        source, still = lumas(footage.pictures), still_pixels(footage.pictures)
        if not still.any():
            sys.exit(f"nothing was measured: no pixel of {clip} is still")
        starts = [gop.first_frame for gop in result.gop_stats]
        own, variance, within, between = noise(source, coded, still, starts)
        row = Noise(
            clip.name, float(still.mean()), ours.bpp, result.psnr, own, variance, within, between
        )
        rows.append(row)
        print(line(row), flush=True)
        if drawn is not None:
            cv2.imwrite(str(drawn), strip(source, coded, still))
    print(f"mean variance, decoded over source: {fmean(row.variance for row in rows):.2f}")
    if output is not None:
        save(output, document("tests.benchmarks.still", added | {"frames": frames}, rows))


def line(row: Noise) -> str:
    """A row of the table."""
    between = f"{'-':>8}" if row.between is None else f"{row.between:8.2f}"
    figures = f"{row.bpp:8.4f}{row.psnr:7.2f}{row.variance:9.2f}{row.within:8.2f}{between}"
    return f"{row.clip[:28]:28}{row.share:7.1%}{figures}"


if __name__ == "__main__":
    sys.exit(main())
