"""Backgrounds: static runs of GOPs are found, so that their background is stored once."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

import cv2
import numpy as np
from numpy.typing import NDArray

from gsvrcodec.encoder.analysis import FrameStats
from gsvrcodec.encoder.tuned import ANALYSIS, BACKGROUND
from gsvrcodec.errors import InputError
from gsvrcodec.fit.flow import Image, resize
from gsvrcodec.fit.start import gradient
from gsvrcodec.model.background import Background


@dataclass(frozen=True, slots=True, eq=False)
class StaticRun:
    """GOPs of one shot, one after another, most of whose detail is static."""

    number: int  #: of the background, from 1
    gops: range  #: positions among the GOPs
    share: float  #: static detail, as a fraction of all detail
    picture: Image  #: (H, W, 3) the static detail; moving areas are blurred


def static_runs(
    frames: Iterable[Image], gops: Sequence[range], stats: Sequence[FrameStats]
) -> Iterator[StaticRun]:
    """Yield static runs of two GOPs or more between cuts.

    A run grows GOP by GOP while its small pictures are static; pictures of full size decide
    whether it is worth a background. No frame is asked for if no two GOPs belong to one shot.

    Args:
        frames: (H, W, 3) uint8, read one at a time.
        gops: frames of each.
        stats: statistics of every frame.

    Raises:
        InputError: there are fewer frames.
    """
    if all(stats[gop.start].cut for gop in gops[1:]):
        return
    pictures, number = iter(frames), 1
    run = _Run(0)
    for position, gop in enumerate(gops):
        samples = list(_samples(pictures, gop))
        small = [resize(sample, ANALYSIS.height) for sample in samples]
        cut = stats[gop.start].cut or gop.stop - gops[run.start].start > BACKGROUND.longest_frames
        if position and (cut or not run.is_static_with(small)):
            if (static := run.static(number)) is not None:
                yield static
                number += 1
            run = _Run(position)
        run.add(samples, small)
    if (static := run.static(number)) is not None:
        yield static


def _samples(frames: Iterator[Image], gop: range) -> Iterator[Image]:
    """Yield some frames of a GOP, evenly spread, and read to its end."""
    wanted = set(np.linspace(0, len(gop) - 1, BACKGROUND.gop_samples).round().astype(int).tolist())
    found = 0
    for found, frame in enumerate(islice(frames, len(gop)), 1):
        if found - 1 in wanted:
            yield frame
    if found < len(gop):
        raise InputError("the video became shorter while it was read")


class _Run:
    """GOPs that follow each other, and some of their frames."""

    def __init__(self, start: int) -> None:
        self.start = self._stop = start
        self._samples: list[Image] = []
        self._small: list[Image] = []

    def is_static_with(self, small: Sequence[Image]) -> bool:
        """Whether the next GOP, by its small frames, is static with the run."""
        median = _median([*self._small, *small])
        share = _share(median, small, _outlasts(median, _change(median, small)))
        return share >= BACKGROUND.least_share

    def add(self, samples: Sequence[Image], small: Sequence[Image]) -> None:
        """Append a GOP: some of its frames, and the same frames made small."""
        self._stop += 1
        self._samples += samples
        self._small += small
        while len(self._samples) > BACKGROUND.most_samples:
            del self._samples[1::2], self._small[1::2]

    def static(self, number: int) -> StaticRun | None:
        """Return the run, if it is worth a background of this number."""
        if self._stop - self.start < 2:
            return None
        picture, share = static_picture(self._samples)
        if share < BACKGROUND.least_share:
            return None
        return StaticRun(number, range(self.start, self._stop), share, picture)


def static_picture(samples: Sequence[Image]) -> tuple[Image, float]:
    """Return the median picture of frames, and the static fraction of their detail.

    Moving areas are blurred in the picture, so that no Gaussian is spent on them.

    Args:
        samples: (H, W, 3) frames of one shot.
    """
    median = _median(samples)
    change = _change(median, samples)
    lasts = _outlasts(median, change)
    blurred = cv2.GaussianBlur(median, (0, 0), BACKGROUND.blur_px)
    picture = np.where((lasts | (change < BACKGROUND.change_codes))[..., None], median, blurred)
    return picture, _share(median, samples, lasts)


def shows(picture: Image, frames: Sequence[Image] | NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Return where frames show a picture, (H, W)."""
    change = _change(picture, frames)
    same: NDArray[np.bool_] = (change < BACKGROUND.change_codes) | _outlasts(picture, change)
    return same


def _share(picture: Image, frames: Sequence[Image], lasts: NDArray[np.bool_]) -> float:
    """Detail of a picture where it is static, as a fraction of the detail of frames."""
    whole = sum(float(gradient(frame).sum()) for frame in frames) / len(frames)
    return min(1.0, float(gradient(picture)[lasts].sum()) / max(whole, 1e-9))


def _change(picture: Image, frames: Sequence[Image] | NDArray[np.uint8]) -> NDArray[np.float32]:
    """Mean squared difference of frames and a picture around each pixel, (H, W)."""
    change = np.zeros(picture.shape[:2], np.float32)
    for frame in frames:
        change += np.square(cv2.absdiff(frame, picture).astype(np.float32)).mean(axis=2)
    return _blurred(change / np.float32(len(frames)))


def _outlasts(picture: Image, change: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Return where the variance of a picture is far above its change, (H, W)."""
    values = picture.astype(np.float32)
    variance = (_blurred(np.square(values)) - np.square(_blurred(values))).mean(axis=2)
    lasting: NDArray[np.bool_] = change < BACKGROUND.change_share * variance
    return lasting


def visible_gaussians(
    background: Background, picture: Image, frames: NDArray[np.uint8]
) -> NDArray[np.bool_]:
    """Return which Gaussians of a background the frames (F, H, W, 3) of a GOP show, (N,)."""
    height, width = picture.shape[:2]
    where = shows(picture, frames)
    x, y = np.floor((background.gop.position + 1) / 2 * (width, height)).astype(np.intp).T
    shown: NDArray[np.bool_] = where[np.clip(y, 0, height - 1), np.clip(x, 0, width - 1)]
    return shown


def _median(samples: Sequence[Image]) -> Image:
    return np.asarray(np.median(np.stack(samples), axis=0), np.uint8)


def _blurred(values: NDArray[np.float32]) -> NDArray[np.float32]:
    box = cv2.boxFilter(values, -1, 2 * (BACKGROUND.box_px,))
    out: NDArray[np.float32] = np.asarray(box, np.float32)
    return out
