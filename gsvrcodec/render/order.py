"""The order in which Gaussians are rendered fastest: those that share pixels follow each other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.model.gop import Float32Array

_TILE_PX = 32


def tile_order(position: Float32Array, size: tuple[int, int]) -> NDArray[np.intp]:
    """A permutation that visits the frame tile by tile.

    Args:
        position: (N, 2) canonical centres, [-1, 1] is the frame.
        size: width and height of the frame, pixels.

    Returns:
        (N,) indices; ties keep the given order.
    """
    tiles = np.maximum(np.array(size) // _TILE_PX, 1)
    cell = np.clip(((position + 1) * (0.5 * tiles)).astype(np.int64), 0, tiles - 1)
    return np.argsort(cell[:, 1] * tiles[0] + cell[:, 0], kind="stable")
