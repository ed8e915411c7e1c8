"""Frames that were never seen: encode every second frame, render the times between."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from itertools import islice
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np

import gsvrcodec
from gsvrcodec.metrics import psnr
from gsvrcodec.video import Crop, OutputInfo, Rgb, open_video, open_writer

#: Of the shortened video; its frames are two ticks apart, so that those between fall on ticks.
TIME_BASE = Fraction(1, 25)


@dataclass(frozen=True, slots=True)
class Interpolation:
    """How well the frames that were seen, and those between them, come out."""

    settings: dict[str, Any]
    train: float  #: dB, mean of the frames that were encoded
    test: float  #: dB, mean of the frames between them
    test_inside: float  #: dB, the same without those between two GOPs
    bpp: float  #: of the frames that were encoded
    train_frames: tuple[float, ...]  #: dB
    test_frames: tuple[float, ...]  #: dB


def interpolate(
    source: Path, crop: Crop, frames: int | None, settings: Mapping[str, Any], folder: Path
) -> Interpolation:
    """Encode frames 0, 2, 4, ... of a video, and compare them and those between with it."""
    with open_video(source, crop, frames=frames) as video:
        shortened, file = folder / "every-second.mkv", folder / "every-second.gsvr"
        shown = [shot.rgb for shot in islice(video, 0, None, 2)]
        _write(shortened, shown)
        gsvrcodec.encode(shortened, file, overwrite=True, **settings)
        count = 2 * len(shown) - 1
        with gsvrcodec.open(file) as decoder:
            seconds = [number * TIME_BASE for number in range(count)]
            values = [
                psnr(shot.rgb, np.asarray(picture, np.uint8))
                for shot, (_, picture) in zip(
                    islice(video, count), decoder.rendered(seconds), strict=True
                )
            ]
            bpp, ends = decoder.metadata.bpp, set(_gop_ends(file))
    train, test = values[::2], values[1::2]
    inside = [value for number, value in enumerate(test) if number not in ends]
    return Interpolation(
        dict(settings), fmean(train), fmean(test), fmean(inside), bpp, tuple(train), tuple(test)
    )


def _gop_ends(file: Path) -> Iterator[int]:
    """The last encoded frame of each GOP."""
    from gsvrcodec.report.inspect import inspect

    for gop in inspect(file).gops:
        yield gop.first_frame + gop.frames - 1


def _write(path: Path, pictures: list[Rgb]) -> None:
    """Write pictures without loss, two ticks each."""
    height, width = pictures[0].shape[:2]
    info = OutputInfo(
        width=width,
        height=height,
        time_base=TIME_BASE,
        rate=1 / (2 * TIME_BASE),
        frames=len(pictures),
    )
    with open_writer(path, info, overwrite=True) as writer:
        for number, rgb in enumerate(pictures):
            writer.write(rgb, 2 * number, 2)
