"""The plate of a key GOP: what stands still, as one picture behind all Gaussians."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray

from gsvrcodec.fit.footage import Frames, Picture, some_frames
from gsvrcodec.fit.start import density
from gsvrcodec.fit.tuned import PLATE


@dataclass(frozen=True, slots=True, eq=False)
class Still:
    """What stands still."""

    picture: Picture  #: (H, W, 3); where it moves, what is there most often
    lasts: bool  #: most of it for the whole chain


def still_picture(frames: Frames, several: Frames | None = None) -> Still | None:
    """Return what stands still in the whole chain, or else in the GOP; None where it is too little.

    Args:
        frames: (F, H, W, 3) of the GOP.
        several: (K, H, W, 3) some frames of its chain, evenly spread; None = the GOP is all of it.
    """
    if len(frames) < PLATE.least_frames:
        return None
    own = frames[some_frames(len(frames), PLATE.frames)]
    usual, share = _standing(own if several is None else several)
    if share >= PLATE.mostly:
        return Still(usual, lasts=share >= PLATE.still)
    if several is None:
        return None
    usual, share = _standing(own)
    return Still(usual, lasts=False) if share >= PLATE.still else None


def _standing(pictures: Frames) -> tuple[Picture, float]:
    """Return what most pictures show, (H, W, 3), and the share of its detail that stands still."""
    usual, seen = most_usual(pictures)
    still = seen >= PLATE.usual * len(pictures)
    return usual, float((density(usual[None]) * still).sum())


def pays(still: Still, coded: int) -> bool:
    """Return whether a plate is better than Gaussians alone.

    One that lasts is, if it shows anything. Else Gaussians take more bits for texture, and fewer
    for what is smooth.

    Args:
        still: What it shows.
        coded: About its bytes.
    """
    least = PLATE.empty_bits if still.lasts else PLATE.least_bits
    return 8 * coded >= least * still.picture[..., 0].size


def most_usual(pictures: Frames) -> tuple[Picture, NDArray[np.uint8]]:
    """Return what most pictures show, (H, W, 3), and how many of them do, (H, W), place by place.

    It is the mean of those pictures, which has less noise than any of them.

    Args:
        pictures: (K, H, W, 3).
    """
    alike = np.ones(pictures.shape[:3], np.uint8)
    for one, other in combinations(range(len(pictures)), 2):
        same = ~differs(pictures[one], pictures[other])
        alike[one] += same
        alike[other] += same
    best = alike.argmax(axis=0)
    middle = np.take_along_axis(pictures, best[None, ..., None], axis=0)[0]
    total, count = np.zeros(middle.shape, np.float32), np.zeros(middle.shape[:2], np.uint8)
    for picture in pictures:
        same = ~differs(picture, middle)
        total += picture * same[..., None]
        count += same
    mean = (total / np.maximum(count, 1)[..., None]).round().astype(np.uint8)
    return np.where(count[..., None] > 0, mean, middle), count


def differs(frame: Picture, usual: Picture) -> NDArray[np.bool_]:
    """Return where a frame, (H, W, 3), is not as a picture, but for noise, (H, W)."""
    apart = cv2.blur(cv2.absdiff(frame, usual), 2 * (PLATE.box_px,))
    red, green, blue = cv2.split(apart)
    return np.asarray(cv2.max(cv2.max(red, green), blue) >= PLATE.differing)


def quality_at(worth: float) -> int:
    """Return the quality of a plate, 0 to 100, at which a bit saves what it has to.

    Args:
        worth: What a bit has to save in each frame, squared 8-bit codes, mean of the channels.
    """
    qualities, saved = PLATE.saves.keys(), np.log(list(PLATE.saves.values()))
    return round(float(np.interp(np.log(worth), saved, list(qualities))))
