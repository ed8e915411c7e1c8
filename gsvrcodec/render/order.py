"""The order in which Gaussians are rendered fastest: those that share pixels follow each other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.model.gop import Float32Array, Gop, parameters_of
from gsvrcodec.model.static import resized
from gsvrcodec.native import _core


def drawing_order(
    position: Float32Array, log_scale: Float32Array, size: tuple[int, int]
) -> NDArray[np.int64]:
    """A permutation that visits the levels of a frame one by one, and each of them tile by tile.

    Args:
        position: (N, 2) canonical centres, [-1, 1] is the frame.
        log_scale: (N, 2) natural logarithms of sigma in pixels of the frame.
        size: width and height of the frame, pixels.

    Returns:
        (N,) indices; ties keep the given order.
    """
    order = np.empty(len(position), np.int64)
    _core.drawing_order(position, log_scale, *size, order)
    return order


def arranged(gop: Gop, size: tuple[int, int]) -> Gop:
    """Return the Gaussians as several frames are rendered fastest.

    Those that move come before those that stand still, which are drawn once; each in drawing order.

    Args:
        gop: Gaussians.
        size: width and height of the coded frame, pixels.
    """
    out = resized(gop, len(gop))
    _core.arrange(parameters_of(gop), *size, parameters_of(out))
    return out
