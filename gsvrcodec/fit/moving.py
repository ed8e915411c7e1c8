"""Where the source moves, and which Gaussians lie elsewhere: they are to be static."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from gsvrcodec.fit.footage import Frames, Moving, Picture
from gsvrcodec.fit.tuned import MOVING
from gsvrcodec.model.gop import Float32Array, Gop
from gsvrcodec.model.prediction import Look

#: Rows at a time, so that their sums stay in the cache.
_ROWS = 32


class OverTime:
    """Mean and variance of the frames of one shot, by pixel and channel.

    Args:
        frames: (F, H, W, 3).
    """

    def __init__(self, frames: Frames) -> None:
        self._count = count = len(frames)
        self._mean, self._variance = np.empty((2, *frames.shape[1:]), np.float32)
        for top in range(0, frames.shape[1], _ROWS):
            rows, own = frames[:, top : top + _ROWS], slice(top, top + _ROWS)
            total, squares = np.zeros((2, *rows.shape[1:]), np.float32)
            for part in rows:
                cv2.accumulate(part, total)
                cv2.accumulateSquare(part, squares)
            self._mean[own] = total / count
            self._variance[own] = (squares - total * total / count) / max(count - 1, 1)

    def moving(self, worth: float) -> Moving:
        """Return where frames differ from each other by more than the bits of motion are worth.

        Args:
            worth: squared error, summed over the frames, that motion has to save for each pixel;
                8-bit codes, mean of the channels.
        """
        return self._more(self._variance, worth)

    def changed(self, before: Picture, worth: float) -> Moving:
        """Return where their mean differs from the frame before them by more than `worth`.

        What the noise of the frames makes of this difference is taken off.

        Args:
            before: (H, W, 3) the frame before them.
            worth: squared error as for `moving`.
        """
        noise = self._variance * (1 + 1 / self._count)
        return self._more(np.square(self._mean - before) - noise, worth)

    def _more(self, squares: Float32Array, worth: float) -> Moving:
        """Where squared differences, (H, W, 3), are more in the mean of a box, over all frames."""
        near = cv2.blur(squares, 2 * (MOVING.box_px,))
        return np.asarray(near.mean(axis=2) > worth / self._count)


def to_be_static(look: Look | Gop, where: Moving) -> NDArray[np.bool_]:
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
