"""Pyramid levels: large Gaussians are drawn at lower resolution (spec section "Levels")."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.model.attributes import ATTRIBUTES
from gsvrcodec.model.gop import Float32Array, Gop
from gsvrcodec.model.reconstruction import LEVEL_SCALE, LEVELS

#: Columns and rows of the picture by which Gaussians of a level are ordered: with two layers a
#: level they can be numbered by 16 bits, which NumPy sorts fast.
_COLUMNS, _ROWS = 128, 32


def zoom(size: tuple[int, int], coded_size: tuple[int, int]) -> float:
    """Scale factor from the coded frame to a frame of `size`, the smaller of the two axes'."""
    return min(size[0] / coded_size[0], size[1] / coded_size[1])


def level_of(log_scale: Float32Array, zoom: float) -> NDArray[np.intp]:
    """Pyramid level of each Gaussian, shape (N,), from `log_scale`, shape (N, 2), and `zoom`."""
    bounds = [math.log(LEVEL_SCALE * 2**level / zoom) for level in range(1, LEVELS)]
    least = np.minimum(log_scale[:, 0], log_scale[:, 1])
    level: NDArray[np.intp] = np.searchsorted(np.array(bounds, np.float32), least, side="right")
    return level


def by_level(gop: Gop) -> Gop:
    """Order the Gaussians for speed: dynamic before static ones, by pyramid level, then place."""
    dynamic = gop.indicator != 1
    for motion in (*gop.linear.T, *gop.quadratic.T):
        dynamic |= motion != 0
    layer = level_of(gop.log_scale, 1.0) + LEVELS * ~dynamic
    # Gaussians that follow each other are drawn to pixels that are still in the cache.
    inside = np.clip((gop.position + 1) / 2, 0, 0.999)
    column, row = (inside * np.array([_COLUMNS, _ROWS], np.float32)).astype(np.intp).T
    place = (layer * _ROWS + row) * _COLUMNS + column
    order = np.argsort(place.astype(np.uint16), kind="stable")
    per_gaussian = (a.name for a in ATTRIBUTES if a.grid == "gaussians")
    return replace(gop, **{name: np.take(getattr(gop, name), order, 0) for name in per_gaussian})


def level_size(size: tuple[int, int], level: int) -> tuple[int, int]:
    """Width and height of a pyramid level of a frame of `size`."""
    return -(-size[0] >> level), -(-size[1] >> level)
