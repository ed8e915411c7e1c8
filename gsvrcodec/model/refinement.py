"""Finer values for the Gaussians that need them (spec section "Refinement").

What rounding a parameter costs depends on the Gaussian: on its area, its shape, and its opacity,
which hides what others show. One step for all would be too fine for most of them. So the planes
hold a base value of each parameter, and a Gaussian has some bits more, by its base scales and its
base opacity.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.model.gop import Float32Array

Levels = NDArray[np.int16]
Bits = NDArray[np.int8]  #: how many bits refine values
Numbers = NDArray[np.uint8]  #: what these bits say

#: Attributes that can be refined, in the order of the refinement.
REFINED = ("position", "log_scale", "rotation", "colour", "linear", "quadratic")
#: Most bits that refine a value.
MOST_BITS = 8

#: 1 / ln 2: octaves of a natural logarithm.
_OCTAVES = 1.4426950408889634


@dataclass(frozen=True, slots=True)
class Refinement:
    """Bits that refine the values of one attribute: level - least, between 0 and most."""

    least: int = 0  #: level up to which a Gaussian has no more bits
    most: int = 0  #: most bits of a value; 0 = the attribute is not refined

    def bits(self, levels: Levels) -> Bits:
        """Return how many bits refine each value."""
        return np.asarray(np.clip(levels - np.int16(self.least), 0, self.most), np.int8)


#: Refinement of each attribute; attributes that it lacks are not refined.
Refinements = Mapping[str, Refinement]


def levels(log_scale: Float32Array, log_opacity: Float32Array) -> dict[str, Levels]:
    """Return the level of each Gaussian for each attribute of `REFINED`, (N,).

    A level more stands for a rounding error of four times the cost.

    Args:
        log_scale: (N, 2) base values, as dequantised.
        log_opacity: (N,) base values, as dequantised; zeros where pictures are sums.
    """
    first, second = log_scale.astype(np.float64).T
    area = _octaves(first + second)
    shape = _octaves(np.abs(first - second))
    opacity = _octaves(log_opacity.astype(np.float64))
    # Shifts divide by 8 and round down.
    place = (3 * shape + 2 * opacity - area) >> 3
    return {
        "position": place,
        "log_scale": (2 * area + 3 * opacity) >> 3,
        "rotation": (2 * area + 8 * shape + 3 * opacity) >> 3,
        "colour": 3 * (area + opacity) >> 3,
        "linear": place,
        "quadratic": place,
    }


def _octaves(values: NDArray[np.float64]) -> Levels:
    """Whole octaves of natural logarithms, rounded down."""
    return np.floor(values * _OCTAVES).astype(np.int16)
