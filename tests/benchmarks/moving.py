"""PSNR of moving areas beside x264's: `python -m tests.benchmarks.moving SOURCE FILE.gsvr...`.

A pixel of a frame moves if it differs from the clip's median picture: if the 9x9 box mean of the
absolute difference, mean of the channels, is over 12. The PSNR over those pixels is averaged over
the frames that have at least 0.2 % of them. x264 (medium, a key frame every 12 and by default)
encodes the same frames at many CRFs; between these its PSNR is interpolated, to where it has the
bits of the file, and to where it has the file's PSNR of the whole picture.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import fmean

import click
import cv2
import numpy as np
from numpy.typing import NDArray

from gsvrcodec.metrics import psnr_of, squared_error
from gsvrcodec.report.curve import RateCurve
from gsvrcodec.video import Rgb
from tests.benchmarks import x264
from tests.benchmarks.footage import Footage, read
from tests.benchmarks.machine import command, commit, machine

#: Every sixth frame goes into the median picture.
_STEP = 6
#: Side of the box, pixels, and the least difference of a moving pixel, code values.
_BOX = 9
_LEAST_DIFFERENCE = 12.0
#: Least share of moving pixels in a frame that counts.
_LEAST_SHARE = 0.002
#: Rows of which the median is taken at a time, to bound the memory.
_SLAB = 64

KEYS = (12, None)
CRFS = tuple(range(12, 49, 4))

Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Point:
    """Rate and quality of one encode."""

    bpp: float  #: bits a pixel and frame
    psnr: float  #: of the whole picture, dB, mean over frames
    moving: float  #: of moving areas, dB, mean over the frames that have any


@dataclass(frozen=True, slots=True)
class Comparison:
    """A file beside one encoder; None = outside of the range of its CRFs."""

    label: str
    equal_bits: Point | None  #: the encoder at the bits of the file
    equal_psnr: Point | None  #: the encoder at the PSNR of the file


def median_picture(pictures: Sequence[Rgb]) -> NDArray[np.float32]:
    """Return the median of every sixth picture, (H, W, 3)."""
    chosen = pictures[::_STEP]
    result = np.empty(chosen[0].shape, np.float32)
    for row in range(0, len(result), _SLAB):
        rows = slice(row, row + _SLAB)
        result[rows] = np.median([picture[rows] for picture in chosen], axis=0)
    return result


def difference(picture: Rgb, still: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return how much each pixel differs from the median picture, (H, W), code values."""
    channels = np.abs(picture - still).mean(axis=2)
    return np.asarray(cv2.blur(channels, (_BOX, _BOX)), np.float32)


def moving(picture: Rgb, still: NDArray[np.float32]) -> Mask:
    """Return which pixels move, (H, W)."""
    return difference(picture, still) > _LEAST_DIFFERENCE


def masks(pictures: Sequence[Rgb]) -> list[Mask | None]:
    """Return what moves in each picture; None = too little to count."""
    still = median_picture(pictures)
    found = (moving(picture, still) for picture in pictures)
    return [mask if mask.mean() >= _LEAST_SHARE else None for mask in found]


def moving_psnr(source: Rgb, coded: Rgb, mask: Mask) -> float:
    """Return the PSNR over the pixels of a mask, all channels, dB."""
    return psnr_of(squared_error(source[mask], coded[mask]))


def point(
    bpp: float, footage: Footage, areas: Sequence[Mask | None], coded: Iterable[Rgb]
) -> Point:
    """Measure decoded pictures.

    Raises:
        ValueError: Nothing moves in any picture.
    """
    whole, inside = [], []
    for source, mask, picture in zip(footage.pictures, areas, coded, strict=True):
        whole.append(psnr_of(squared_error(source, picture)))
        if mask is not None:
            inside.append(moving_psnr(source, picture, mask))
    if not inside:
        raise ValueError("nothing moves in these frames")
    return Point(bpp, fmean(whole), fmean(inside))


def compare(ours: Point, label: str, theirs: Sequence[Point]) -> Comparison:
    """Interpolate an encoder's points to the bits and to the PSNR of a file."""
    by_psnr = RateCurve((p.psnr, p.bpp) for p in theirs)
    by_moving = RateCurve((p.moving, p.bpp) for p in theirs)

    def at(bpp: float | None) -> Point | None:
        if bpp is None:
            return None
        psnr, inside = by_psnr.quality_at(bpp), by_moving.quality_at(bpp)
        return None if psnr is None or inside is None else Point(bpp, psnr, inside)

    return Comparison(label, at(ours.bpp), at(by_psnr.rate(ours.psnr)))


def ladder(footage: Footage, areas: Sequence[Mask | None], key: int | None) -> Iterator[Point]:
    """Measure x264 at each CRF, best quality first."""
    with tempfile.TemporaryDirectory() as folder:
        for crf in CRFS:
            encode = x264.encode(footage, Path(folder) / "x264.mp4", crf, key)
            yield point(encode.bpp, footage, areas, encode.pictures())


def lines(name: str, ours: Point, found: Iterable[Comparison]) -> Iterator[str]:
    """Yield the table of a file."""
    yield f"{name[:36]:36}{ours.bpp:8.4f}{ours.psnr:8.2f}{ours.moving:8.2f}"
    for one in found:
        for what, other in ("bits", one.equal_bits), ("PSNR", one.equal_psnr):
            text = f"  {one.label}, equal {what}"
            if other is None:
                yield f"{text:36}  outside of CRF {CRFS[0]} to {CRFS[-1]}"
            else:
                yield (
                    f"{text:36}{other.bpp:8.4f}{other.psnr:8.2f}{other.moving:8.2f}"
                    f"{ours.psnr - other.psnr:+8.2f}{ours.moving - other.moving:+8.2f}"
                )


@click.command()
@click.argument("source", type=click.Path(path_type=Path, exists=True))
@click.argument(
    "files", nargs=-1, required=True, type=click.Path(path_type=Path, exists=True, dir_okay=False)
)
@click.option(
    "--frames",
    type=click.IntRange(min=2),
    help="The first ones only, to try it out: bits are still those of the whole file.",
)
@click.option("--json", "output", type=click.Path(path_type=Path), help="Write all of it here.")
def main(source: Path, files: tuple[Path, ...], frames: int | None, output: Path | None) -> None:
    """Compare FILES, all of the same frames of SOURCE, with x264 where something moves."""
    footage, first = read(source, files[0], frames)
    areas = masks(footage.pictures)
    counted = [mask for mask in areas if mask is not None]
    if not counted:
        sys.exit(f"nothing was measured: in none of the frames of {source} something moves")
    share = fmean(float(mask.mean()) for mask in counted)
    print(machine())
    print(
        f"{source.name}, {first.frames} frames of {footage.info.width}x{footage.info.height}; "
        f"moving areas in {len(counted)} of them, {share:.1%} of these"
    )
    curves = {x264.label(key): list(ladder(footage, areas, key)) for key in KEYS}
    print(f"{'':36}{'bpp':>8}{'PSNR':>8}{'moving':>8}{'ours: PSNR':>11}{'moving':>7}")
    rows = []
    for file in files:
        own, other = (footage, first) if file == files[0] else read(source, file, frames)
        if not footage.same(own):
            sys.exit(f"{file} is not of the same frames as {files[0]}")
        ours = point(other.bpp, own, areas, other.pictures())
        found = [compare(ours, name, points) for name, points in curves.items()]
        print(*lines(file.name, ours, found), sep="\n", flush=True)
        rows.append(
            {"file": file.name, "ours": asdict(ours), "against": [asdict(one) for one in found]}
        )
    if output is not None:
        document = {
            "machine": machine(),
            "commit": commit(),
            "command": command("tests.benchmarks.moving"),
            "source": source.name,
            "size": (footage.info.width, footage.info.height),
            "frames": first.frames,
            "frames_with_motion": len(counted),
            "share_moving": share,
            "rows": rows,
            "points": {name: [asdict(p) for p in points] for name, points in curves.items()},
        }
        output.write_text(json.dumps(document, indent=1) + "\n")


if __name__ == "__main__":
    sys.exit(main())
