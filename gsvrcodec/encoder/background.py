"""What stands still from GOP to GOP of a shot: found, so that it can be fitted and stored once."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

import cv2
import numpy as np
from numpy.typing import NDArray

from gsvrcodec.encoder.analysis import ANALYSIS_HEIGHT, FrameStats
from gsvrcodec.errors import InputError
from gsvrcodec.fit.flow import Image, resize
from gsvrcodec.fit.start import gradient
from gsvrcodec.model.background import Background

#: Frames of a GOP and of a run that are looked at.
_GOP_SAMPLES, _MOST_SAMPLES = 4, 16
#: The most frames that share a background: light changes.
_LONGEST = 400
#: A place stands still if what changes there, in mean square, is less than this share of its
#: variance, or than so many squared codes.
_CHANGE_SHARE, _CHANGE_CODES = 0.25, 20.0
_BOX_PX = 9
#: How much what moves is blurred in the picture of what does not, px.
_BLUR_PX = 8.0
#: Least part of the detail that has to stand still, in the run and in each of its GOPs; with less
#: nothing was gained.
_LEAST_SHARE = 0.6


@dataclass(frozen=True, slots=True, eq=False)
class StillShot:
    """A run of GOPs between cuts, much of which stands still."""

    number: int  #: of its background, from 1
    gops: range  #: positions among the GOPs
    share: float  #: of all detail, that of what stands still
    picture: bytes  #: what stands still, a PNG file; what moves in it is blurred


def still_shots(
    frames: Iterable[Image], gops: Sequence[range], steps: Sequence[FrameStats]
) -> Iterator[StillShot]:
    """Yield runs of two GOPs or more between cuts, much of which stands still.

    A run grows GOP by GOP as long as small pictures stand still; pictures of full size decide
    whether it is worth a background. No frame is asked for if no two GOPs belong to one shot.

    Args:
        frames: (H, W, 3) uint8, read one at a time.
        gops: frames of each.
        steps: every frame as `analyse` measured it.

    Raises:
        InputError: there are fewer frames.
    """
    if all(steps[gop.start].cut for gop in gops[1:]):
        return
    pictures, number = iter(frames), 1
    run = _Run(0)
    for position, gop in enumerate(gops):
        samples = list(_samples(pictures, gop))
        small = [resize(sample, ANALYSIS_HEIGHT) for sample in samples]
        cut = steps[gop.start].cut or gop.stop - gops[run.start].start > _LONGEST
        if position and (cut or not run.stands_still_with(small)):
            if (still := run.still(number)) is not None:
                yield still
                number += 1
            run = _Run(position)
        run.add(samples, small)
    if (still := run.still(number)) is not None:
        yield still


def _samples(frames: Iterator[Image], gop: range) -> Iterator[Image]:
    """Yield some frames of a GOP, evenly spread, and read to its end."""
    wanted = set(np.linspace(0, len(gop) - 1, _GOP_SAMPLES).round().astype(int).tolist())
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

    def stands_still_with(self, small: Sequence[Image]) -> bool:
        """Whether frames after the run, made small, are much like what stands still in it."""
        median = _median([*self._small, *small])
        return _share(median, small, _outlasts(median, _change(median, small))) >= _LEAST_SHARE

    def add(self, samples: Sequence[Image], small: Sequence[Image]) -> None:
        """Take one more GOP: some of its frames, and the same made small."""
        self._stop += 1
        self._samples += samples
        self._small += small
        while len(self._samples) > _MOST_SAMPLES:
            del self._samples[1::2], self._small[1::2]

    def still(self, number: int) -> StillShot | None:
        """Return the run, if it is worth a background of this number."""
        if self._stop - self.start < 2:
            return None
        picture, share = still_picture(self._samples)
        if share < _LEAST_SHARE:
            return None
        return StillShot(number, range(self.start, self._stop), share, still_png(picture))


def still_png(picture: Image) -> bytes:
    """Return a picture (H, W, 3) as a PNG file."""
    return cv2.imencode(".png", picture[..., ::-1])[1].tobytes()


def still_rgb(png: bytes) -> Image:
    """Return the picture in a PNG file of a `StillShot`, (H, W, 3)."""
    bgr = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    assert bgr is not None
    return np.ascontiguousarray(bgr[..., ::-1], np.uint8)


def still_picture(samples: Sequence[Image]) -> tuple[Image, float]:
    """Return the picture of what stands still in frames, and its share of all detail.

    What moves is blurred in it, so that nothing is spent on it.

    Args:
        samples: (H, W, 3) frames of one shot.
    """
    median = _median(samples)
    change = _change(median, samples)
    lasts = _outlasts(median, change)
    blurred = cv2.GaussianBlur(median, (0, 0), _BLUR_PX)
    picture = np.where((lasts | (change < _CHANGE_CODES))[..., None], median, blurred)
    return picture, _share(median, samples, lasts)


def at_rest(picture: Image, frames: Sequence[Image] | NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Return where frames look like a picture, (H, W)."""
    change = _change(picture, frames)
    rests: NDArray[np.bool_] = (change < _CHANGE_CODES) | _outlasts(picture, change)
    return rests


def _share(picture: Image, frames: Sequence[Image], lasts: NDArray[np.bool_]) -> float:
    """Of the detail of frames, that of a picture where it lasts."""
    whole = sum(float(gradient(frame).sum()) for frame in frames) / len(frames)
    return min(1.0, float(gradient(picture)[lasts].sum()) / max(whole, 1e-9))


def _change(picture: Image, frames: Sequence[Image] | NDArray[np.uint8]) -> NDArray[np.float32]:
    """Mean square of what frames have otherwise than a picture, around each pixel, (H, W)."""
    change = np.zeros(picture.shape[:2], np.float32)
    for frame in frames:
        change += np.square(cv2.absdiff(frame, picture).astype(np.float32)).mean(axis=2)
    return _blurred(change / np.float32(len(frames)))


def _outlasts(picture: Image, change: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Return where a picture has far more detail than changes, (H, W)."""
    values = picture.astype(np.float32)
    variance = (_blurred(np.square(values)) - np.square(_blurred(values))).mean(axis=2)
    lasting: NDArray[np.bool_] = change < _CHANGE_SHARE * variance
    return lasting


def shown_of(
    background: Background, picture: Image, frames: NDArray[np.uint8]
) -> NDArray[np.bool_]:
    """Return which Gaussians of a background the frames (F, H, W, 3) of a GOP show, (N,)."""
    height, width = picture.shape[:2]
    rests = at_rest(picture, frames)
    x, y = np.floor((background.gop.position + 1) / 2 * (width, height)).astype(np.intp).T
    shown: NDArray[np.bool_] = rests[np.clip(y, 0, height - 1), np.clip(x, 0, width - 1)]
    return shown


def _median(samples: Sequence[Image]) -> Image:
    return np.asarray(np.median(np.stack(samples), axis=0), np.uint8)


def _blurred(values: NDArray[np.float32]) -> NDArray[np.float32]:
    out: NDArray[np.float32] = np.asarray(cv2.boxFilter(values, -1, (_BOX_PX, _BOX_PX)), np.float32)
    return out
