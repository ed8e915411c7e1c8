"""The plate of a key GOP: what stands still, as one picture behind all Gaussians."""

from __future__ import annotations

from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray

from gsvrcodec.fit.footage import Frames, Picture, some_frames
from gsvrcodec.fit.start import density
from gsvrcodec.fit.tuned import PLATE


def still_picture(frames: Frames, several: Frames | None = None) -> Picture | None:
    """Return what stands still, (H, W, 3); None where it is too little, or lasts too short.

    Where it moves, the picture has what is there most often: in the whole chain, where most of the
    picture stands still that long, or else in the GOP.

    Args:
        frames: (F, H, W, 3) of the GOP.
        several: (K, H, W, 3) some frames of its chain, evenly spread; None = the GOP is all of it.
    """
    if len(frames) < PLATE.least_frames:
        return None
    own = frames[some_frames(len(frames), PLATE.frames)]
    for shown in [own] if several is None else [several, own]:
        usual, seen = most_usual(shown)
        if (density(usual[None]) * (seen >= PLATE.usual * len(shown))).sum() >= PLATE.still:
            return usual
    return None


def pays(coded: int, pixels: int) -> bool:
    """Return whether a plate of so many bytes is better than Gaussians alone.

    Gaussians take more bits for texture than a picture coder, and fewer for what is smooth.

    Args:
        coded: Bytes of the plate.
        pixels: Of the picture.
    """
    return 8 * coded >= PLATE.least_bits * pixels


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
    """Return the quality of a plate, 0 to 100, where a bit has to save so much in each frame.

    Args:
        worth: Squared 8-bit codes, mean of the channels.
    """
    return max(0, round(100 - PLATE.loss * float(np.power(worth, PLATE.power))))
