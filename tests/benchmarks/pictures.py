"""Pictures beside x264's: `python -m tests.benchmarks.pictures SOURCE FILE.gsvr --out DIR`.

x264 (medium, with a key frame every 12, or as `--key` says) encodes the same frames with the bits
of the file. Three kinds of PNG show source, file and x264: one whole frame; the same frame's crops,
doubled; and each crop over time, across GOPs. Without `--crop` the window is taken where most of it
moves (`tests.benchmarks.moving`), without `--frame` the frame in which it moves most.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
from typing import Any

import click
import cv2
import numpy as np

from gsvrcodec.cli.values import crop as crop_value
from gsvrcodec.metrics import psnr
from gsvrcodec.report.inspect import inspect
from gsvrcodec.video import Crop, Rgb
from tests.benchmarks import x264
from tests.benchmarks.footage import read
from tests.benchmarks.moving import difference, median_picture, moving

#: Frames from one key frame of x264 to the next; 0 = as it likes.
KEY = 12
#: Largest window that is chosen without `--crop`, pixels.
WINDOW = (320, 180)
#: Between the places where a window is tried, pixels.
_STRIDE = 8
#: Pictures of a strip, and the frames it covers at least.
STRIP = 8
_SPAN = 24
#: A whole frame's three pictures are scaled down to this width together, pixels.
_WIDTH = 1920
#: Largest file, bytes.
MAX_BYTES = 1_500_000

_FONT = cv2.FONT_HERSHEY_SIMPLEX
_LINE = 22  # height of a caption, pixels
_GAP = 4  # between pictures, pixels
_SCALE = 0.45  # of the font


@dataclass(frozen=True, slots=True)
class Window:
    """A part of the picture, pixels."""

    x: int
    y: int
    width: int
    height: int

    def of(self, picture: Rgb) -> Rgb:
        """Return this part of a picture."""
        return picture[self.y : self.y + self.height, self.x : self.x + self.width]

    @property
    def text(self) -> str:
        """The window as `--crop` has it."""
        return f"{self.width}:{self.height}:{self.x}:{self.y}"


@dataclass(frozen=True, slots=True, eq=False)
class Version:
    """The frames as one codec shows them."""

    name: str
    bpp: float | None  #: bits a pixel and frame; None = the source
    pictures: Sequence[Rgb]

    def caption(self, sources: Sequence[Rgb], frames: Iterable[int], window: Window) -> str:
        """Say what is shown: codec, rate, and mean PSNR of these frames in a window."""
        if self.bpp is None:
            return self.name
        values = (psnr(window.of(sources[n]), window.of(self.pictures[n])) for n in frames)
        return f"{self.name}, {self.bpp:.4f} bpp, {fmean(values):.2f} dB"


def busiest(pictures: Sequence[Rgb]) -> tuple[Window, int]:
    """Return the window in which most moves, and the frame in which it moves most.

    What moves counts by how much it differs from the median picture, so that there is a choice
    also if the camera moves.
    """
    still = median_picture(pictures)
    height, width = pictures[0].shape[:2]
    wide, high = (min(most, side // 2) for most, side in zip(WINDOW, (width, height), strict=True))
    best = (-1.0, 0, 0, 0)
    for number, picture in enumerate(pictures):
        weight = difference(picture, still) * moving(picture, still)
        sums = cv2.integral(weight)
        totals = sums[high:, wide:] - sums[:-high, wide:] - sums[high:, :-wide]
        totals = (totals + sums[:-high, :-wide])[::_STRIDE, ::_STRIDE]
        row, column = divmod(int(totals.argmax()), totals.shape[1])
        best = max(best, (float(totals[row, column]), number, row * _STRIDE, column * _STRIDE))
    return Window(best[3], best[2], wide, high), best[1]


def over_time(starts: Sequence[int], frames: int, around: int, count: int = STRIP) -> list[int]:
    """Return frames for a strip, in order: both sides of GOP borders, and others between.

    Args:
        starts: first frame of each GOP, in order.
        frames: frames of the video.
        around: a frame of the first GOP to show.
        count: how many frames, at least 6.
    """
    ends = [*starts[1:], frames]
    first = max(number for number, start in enumerate(starts) if start <= around)
    while first and frames - starts[first] < _SPAN:
        first -= 1
    last = min(first + 2, len(ends) - 1)
    while last + 1 < len(ends) and ends[last] - starts[first] < _SPAN:
        last += 1
    low, high = starts[first], ends[last]
    borders = starts[first + 1 : last + 1][:2]
    chosen = {low, high - 1, *borders, *(border - 1 for border in borders)}
    while len(chosen) < min(count, high - low):
        shown = sorted(chosen)
        gap, left = max(zip(np.diff(shown), shown, strict=False), key=lambda pair: int(pair[0]))
        chosen.add(left + int(gap) // 2)
    return sorted(chosen)


def captioned(picture: Rgb, text: str) -> Rgb:
    """Return a picture below a line of text, which is made smaller until it fits."""
    width = picture.shape[1]
    bar = np.zeros((_LINE, width, 3), np.uint8)
    wide = cv2.getTextSize(text, _FONT, _SCALE, 1)[0][0]
    scale = _SCALE * min(1.0, (width - 8) / wide)
    cv2.putText(bar, text, (4, _LINE - 7), _FONT, scale, (255, 255, 255), 1, cv2.LINE_AA)
    return np.concatenate([bar, picture])


def joined(pictures: Sequence[Rgb], axis: int) -> Rgb:
    """Return pictures of one height side by side (axis 1), or of one width in a column (0)."""
    parts: list[Rgb] = []
    for picture in pictures:
        if parts:
            shape = [_GAP, _GAP, 3]
            shape[1 - axis] = picture.shape[1 - axis]
            parts.append(np.full(shape, 255, np.uint8))
        parts.append(picture)
    return np.concatenate(parts, axis)


def scaled(picture: Rgb, factor: float) -> Rgb:
    """Return a picture made smaller by area means, or larger by repeated pixels."""
    way = cv2.INTER_AREA if factor < 1 else cv2.INTER_NEAREST
    return np.asarray(cv2.resize(picture, None, fx=factor, fy=factor, interpolation=way), np.uint8)


def save(path: Path, picture: Rgb) -> None:
    """Write a PNG; one that is too large for a page is made smaller."""
    factor = 1.0
    while True:
        shown = picture if factor == 1 else scaled(picture, factor)
        _, data = cv2.imencode(".png", shown[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 9])
        if data.nbytes <= MAX_BYTES:
            break
        factor *= 0.98 * (MAX_BYTES / data.nbytes) ** 0.5
    path.write_bytes(data.tobytes())
    scale = "" if factor == 1 else f", scaled by {factor:.2f} to fit"
    print(f"{path}: {shown.shape[1]}x{shown.shape[0]}, {data.nbytes / 1000:.0f} kB{scale}")


def side_by_side(versions: Sequence[Version], frame: int, window: Window, factor: float) -> Rgb:
    """Return one frame's window in all versions, in a row."""
    sources = versions[0].pictures
    return joined(
        [
            captioned(
                scaled(window.of(version.pictures[frame]), factor),
                version.caption(sources, [frame], window),
            )
            for version in versions
        ],
        axis=1,
    )


def strip(
    versions: Sequence[Version], frames: Sequence[int], window: Window, starts: Sequence[int]
) -> Rgb:
    """Return a window over time, a row for each version; GOPs that start are marked."""
    sources = versions[0].pictures
    names = [f"frame {n}{', a GOP starts' if n in starts else ''}" for n in frames]
    rows: list[Rgb] = []
    for version in versions:
        cells = [window.of(version.pictures[n]) for n in frames]
        if not rows:
            cells = [captioned(cell, name) for cell, name in zip(cells, names, strict=True)]
        rows.append(captioned(joined(cells, 1), version.caption(sources, frames, window)))
    return joined(rows, axis=0)


def windows(crops: Iterable[Crop], width: int, height: int) -> list[Window]:
    """Return crops as windows; a missing column or row is the centre's.

    Raises:
        ValueError: A crop does not fit into the picture.
    """
    found = []
    for wide, high, x, y in crops:
        window = Window(
            (width - wide) // 2 if x is None else x,
            (height - high) // 2 if y is None else y,
            wide,
            high,
        )
        if window.x + wide > width or window.y + high > height or min(window.x, window.y) < 0:
            raise ValueError(f"crop {window.text} does not fit into {width}x{height}")
        found.append(window)
    return found


@click.command()
@click.argument("source", type=click.Path(path_type=Path, exists=True))
@click.argument("file", type=click.Path(path_type=Path, exists=True, dir_okay=False))
@click.option("--out", required=True, type=click.Path(path_type=Path), help="Directory.")
@click.option("--frame", type=click.IntRange(min=0), help="Of the file, from 0.")
@click.option("--crop", "crops", multiple=True, type=crop_value, help="W:H:X:Y, several times.")
@click.option("--key", default=KEY, help="Frames between key frames of x264; 0 = its default.")
def main(
    source: Path, file: Path, out: Path, frame: int | None, crops: tuple[Any, ...], key: int
) -> None:
    """Show FILE, its SOURCE and x264 side by side."""
    footage, own = read(source, file)
    size = footage.info.width, footage.info.height
    if frame is not None and frame >= own.frames:
        raise click.BadParameter(f"{file} has {own.frames} frames", param_hint="--frame")
    try:
        parts = windows(crops, *size)
    except ValueError as error:
        raise click.BadParameter(str(error), param_hint="--crop") from error
    if not parts or frame is None:
        window, busy = busiest(footage.pictures)
        parts = parts or [window]
        frame = busy if frame is None else frame
    with tempfile.TemporaryDirectory() as folder:
        other = x264.match(footage, Path(folder) / "x264.mp4", key or None, own.bpp, "bpp")
        versions = [
            Version("source", None, footage.pictures),
            Version("gsvrcodec", own.bpp, tuple(own.pictures())),
            Version(x264.label(key or None), other.bpp, tuple(other.pictures())),
        ]
    starts = [gop.first_frame for gop in inspect(file).gops]
    whole = Window(0, 0, *size)
    out.mkdir(parents=True, exist_ok=True)
    print(f"frame {frame}; window {', '.join(part.text for part in parts)}")
    for version in versions[1:]:
        print(version.caption(footage.pictures, range(own.frames), whole))
    name = f"{file.stem}-{frame}"
    factor = min(1.0, _WIDTH / (3 * size[0]))
    save(out / f"{name}.png", side_by_side(versions, frame, whole, factor))
    for number, part in enumerate(parts, 1):
        save(out / f"{name}-crop{number}.png", side_by_side(versions, frame, part, 2))
        shown = over_time(starts, own.frames, frame)
        save(out / f"{name}-strip{number}.png", strip(versions, shown, part, starts))


if __name__ == "__main__":
    sys.exit(main())
