"""Pyramid levels: large Gaussians are drawn at lower resolution (spec section "Levels")."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.model.gop import Float32Array
from gsvrcodec.model.reconstruction import LEVEL_SCALE, LEVELS


def zoom(size: tuple[int, int], coded_size: tuple[int, int]) -> float:
    """Scale factor from the coded frame to a frame of `size`, the smaller of the two axes'."""
    return min(size[0] / coded_size[0], size[1] / coded_size[1])


def level_of(log_scale: Float32Array, zoom: float) -> NDArray[np.intp]:
    """Pyramid level of each Gaussian, shape (N,), from `log_scale`, shape (N, 2), and `zoom`."""
    bounds = [math.log(LEVEL_SCALE * 2**level / zoom) for level in range(1, LEVELS)]
    least = np.minimum(log_scale[:, 0], log_scale[:, 1])
    level: NDArray[np.intp] = np.searchsorted(np.array(bounds, np.float32), least, side="right")
    return level


def level_size(size: tuple[int, int], level: int) -> tuple[int, int]:
    """Width and height of a pyramid level of a frame of `size`."""
    return -(-size[0] >> level), -(-size[1] >> level)
