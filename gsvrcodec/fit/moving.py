"""Where the source moves, and which Gaussians lie there: the others need no motion."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from gsvrcodec.fit.footage import Frames
from gsvrcodec.fit.tuned import MOVING
from gsvrcodec.model.gop import Gop
from gsvrcodec.model.prediction import Look

Moving = NDArray[np.bool_]  #: (H, W) where the source moves


def moving(frames: Frames, worth: float) -> Moving:
    """Return where frames differ from each other by more than the bits of motion are worth.

    Args:
        frames: (F, H, W, 3) of one shot.
        worth: squared error, summed over the frames, that motion has to save for each pixel; 8-bit
            codes, mean of the channels.
    """
    total, squares = np.zeros((2, *frames.shape[1:]), np.float32)
    for frame in frames:
        cv2.accumulate(frame, total)
        cv2.accumulateSquare(frame, squares)
    count = len(frames)
    variance = (squares - total * total / count).mean(axis=2) / max(count - 1, 1)
    near = cv2.blur(variance, 2 * (MOVING.box_px,))
    return np.asarray(near > worth / count)


def still_gaussians(look: Look | Gop, where: Moving) -> NDArray[np.bool_]:
    """Return which Gaussians lie where hardly anything moves, (N,)."""
    height, width = where.shape
    table = cv2.integral(where.astype(np.uint8))
    along, across = np.exp(2 * look.log_scale).T
    cosine, sine = np.square(np.cos(look.rotation)), np.square(np.sin(look.rotation))
    reach = np.sqrt([cosine * along + sine * across, sine * along + cosine * across])
    centre = ((look.position + 1) / 2 * (width, height)).T
    size = np.array([[width], [height]])
    # A box of two sigmas to each side, of one pixel at least.
    begin = np.clip(centre - 2 * reach, 0, size - 1).astype(np.intp)
    end = np.clip(centre + 2 * reach + 1, begin + 1, size).astype(np.intp)
    (left, top), (right, bottom) = begin, end
    inside = table[bottom, right] - table[bottom, left] - table[top, right] + table[top, left]
    share = inside / ((right - left) * (bottom - top))
    return np.asarray(share < MOVING.share)
