"""Finer values for the Gaussians that need them (spec section "Refinement").

What rounding a parameter costs depends on the Gaussian: that of a colour grows with the area, that
of scales with the area and the squared colour, that of a place with the squared colour. One step
for all would be too fine for most of them. So the planes hold a base value of each parameter, and
a Gaussian has some bits more, by its base scales and its base colour.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.model.gop import Float32Array

Levels = NDArray[np.int64]

#: Attributes that can be refined, in the order of the refinement.
REFINED = ("position", "log_scale", "rotation", "colour", "linear", "quadratic")
#: Most bits that refine a value.
MOST_BITS = 8

#: 1 / ln 2: octaves of a natural logarithm.
_OCTAVES = 1.4426950408889634
#: Exponent that stands for colours too small to see.
_LEAST_EXPONENT = -8


@dataclass(frozen=True, slots=True)
class Refinement:
    """Bits that refine the values of one attribute: level - least, between 0 and most."""

    least: int = 0  #: level up to which a Gaussian has no more bits
    most: int = 0  #: most bits of a value; 0 = the attribute is not refined

    def bits(self, levels: Levels) -> Levels:
        """Return how many bits refine each value."""
        return np.clip(levels - self.least, 0, self.most)


#: Refinement of each attribute; attributes that it lacks are not refined.
Refinements = Mapping[str, Refinement]


def levels(log_scale: Float32Array, colour: Float32Array) -> dict[str, Levels]:
    """Return the level of each Gaussian for each attribute of `REFINED`, (N,).

    A level more stands for a rounding error of four times the cost.

    Args:
        log_scale: (N, 2) base values, as dequantised.
        colour: (N, 3) base values, as dequantised.
    """
    first, second = log_scale.astype(np.float64).T
    area = np.floor((first + second) * _OCTAVES).astype(np.int64)
    shape = np.floor(np.abs(first - second) * _OCTAVES).astype(np.int64)
    peak = np.abs(colour).max(axis=1, initial=0)
    _, exponent = np.frexp(peak)
    exponent = np.where(peak > 0, exponent, _LEAST_EXPONENT).astype(np.int64)
    exponent = np.maximum(exponent, _LEAST_EXPONENT)
    place = (3 * shape + 8 * exponent) // 8
    return {
        "position": place,
        "log_scale": (area + 2 * exponent) // 2,
        "rotation": (2 * area + 5 * shape + 4 * exponent) // 4,
        "colour": area // 2,
        "linear": place,
        "quadratic": place,
    }
