"""The plate of a key GOP: what stands still, as one picture behind all Gaussians."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from gsvrcodec.fit.footage import Frames, Picture, some_frames
from gsvrcodec.fit.start import density
from gsvrcodec.fit.tuned import PLATE


def still_picture(frames: Frames, several: Frames | None = None) -> Picture | None:
    """Return what stands still, (H, W, 3); None where it is too little, or lasts too short.

    Where it moves, the picture has what is there most of the time: in the whole chain, where most
    of the picture stands still that long, or else in the GOP.

    Args:
        frames: (F, H, W, 3) of the GOP.
        several: (K, H, W, 3) some frames of its chain, evenly spread; None = the GOP is all of it.
    """
    if len(frames) < PLATE.least_frames:
        return None
    own = frames[some_frames(len(frames), PLATE.frames)]
    for shown in [own] if several is None else [several, own]:
        middle = median(shown)
        still = stands_still(shown, middle)
        if (density(middle[None]) * still).sum() >= PLATE.still:
            # Less noise than in the median.
            every = frames if shown is own else np.concatenate([frames, shown])
            mean = every.mean(axis=0, dtype=np.float32).round().astype(np.uint8)
            still &= ~differs(mean, middle)  # as most of the time, all of the time
            return np.where(still[..., None], mean, middle)
    return None


def pays(coded: int, pixels: int) -> bool:
    """Return whether a plate of so many bytes is better than Gaussians alone.

    Gaussians take more bits for texture than a picture coder, and fewer for what is smooth.

    Args:
        coded: Bytes of the plate.
        pixels: Of the picture.
    """
    return 8 * coded >= PLATE.least_bits * pixels


def stands_still(frames: Frames, usual: Picture) -> NDArray[np.bool_]:
    """Return where most of some frames, (F, H, W, 3), are as a picture, (H, W)."""
    count = sum((~differs(frame, usual)).astype(np.uint8) for frame in frames)
    return np.asarray(count >= PLATE.usual * len(frames))


def differs(frame: Picture, usual: Picture) -> NDArray[np.bool_]:
    """Return where a frame, (H, W, 3), is not as a picture, but for noise, (H, W)."""
    apart = cv2.blur(cv2.absdiff(frame, usual), 2 * (PLATE.box_px,))
    return np.asarray(apart.max(axis=2) >= PLATE.differing)


def quality_at(worth: float) -> int:
    """Return the quality of a plate, 0 to 100, where a bit has to save so much in each frame.

    Args:
        worth: Squared 8-bit codes, mean of the channels.
    """
    return max(0, round(100 - PLATE.loss * float(np.power(worth, PLATE.power))))


def median(pictures: Sequence[Picture] | Frames) -> Picture:
    """Return the median of pictures, (H, W, 3), by pixel and channel; of two middle ones the later.

    Quicker than sorting along the first axis: whole pictures are compared.
    """
    ordered: list[Picture] = list(pictures)
    for turn in range(len(ordered)):
        for n in range(turn % 2, len(ordered) - 1, 2):
            low, high = ordered[n : n + 2]
            ordered[n : n + 2] = np.minimum(low, high), np.maximum(low, high)
    return ordered[len(ordered) // 2]
