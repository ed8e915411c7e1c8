"""The order in which Gaussians are rendered fastest: those that share pixels follow each other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.model.gop import Float32Array, Gop
from gsvrcodec.model.pyramid import level_of
from gsvrcodec.model.static import select_gaussians

_TILE_PX = 32


def drawing_order(
    position: Float32Array, log_scale: Float32Array, size: tuple[int, int]
) -> NDArray[np.intp]:
    """A permutation that visits the levels of a frame one by one, and each of them tile by tile.

    Args:
        position: (N, 2) canonical centres, [-1, 1] is the frame.
        log_scale: (N, 2) natural logarithms of sigma in pixels of the frame.
        size: width and height of the frame, pixels.

    Returns:
        (N,) indices; ties keep the given order.
    """
    tiles = np.maximum(np.array(size) // _TILE_PX, 1)
    cell = np.clip(((position + 1) * (0.5 * tiles)).astype(np.int64), 0, tiles - 1)
    level = level_of(log_scale, 1.0)
    place = (level * tiles[1] + cell[:, 1]) * tiles[0] + cell[:, 0]
    # NumPy sorts numbers of 16 bits by far the fastest.
    return np.argsort(place.astype(np.min_scalar_type(place.max(initial=0))), kind="stable")


def arranged(gop: Gop, size: tuple[int, int]) -> Gop:
    """Return the Gaussians as several frames are rendered fastest.

    Those that move come before those that stand still, which are drawn once; each in drawing order.

    Args:
        gop: Gaussians.
        size: width and height of the coded frame, pixels.
    """
    moves = gop.indicator != 1
    for motion in (*gop.linear.T, *gop.quadratic.T):
        moves |= motion != 0
    order = drawing_order(gop.position, gop.log_scale, size)
    return select_gaussians(gop, order[np.argsort(~moves[order], kind="stable")])
