"""One slope of rate and distortion: which Gaussians are worth their bits, and how many."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.fit.precision import bit_worth
from gsvrcodec.fit.tuned import SLOPE


@dataclass(frozen=True, slots=True)
class Slope:
    """What a bit has to save, whatever number of bits that takes."""

    qscale: float  #: of the steps that a GOP is stored with that no other builds on
    most: int  #: bound of the number of Gaussians
    #: how much more a bit saves than in the frames of the GOP, because others build on them
    lasting: float = 1.0

    @property
    def bit(self) -> float:
        """Squared 8-bit codes that a bit of a Gaussian has to save in the frames of the GOP."""
        return bit_worth(self.qscale) / self.lasting

    @property
    def stored_qscale(self) -> float:
        """Factor of the steps of the GOP: finer where others build on it."""
        return self.qscale / math.pow(self.lasting, SLOPE.lasting)

    def gaussians(self, pixels: int, error: float, steps: float) -> int:
        """Return the number of Gaussians at which one more would save just enough.

        Args:
            pixels: Of all frames that show the GOP.
            error: Mean squared error so far, 8-bit codes.
            steps: Of the whole fit; each Gaussian is worth more after many of them.
        """
        count = SLOPE.fall * error * pixels / (SLOPE.gaussian_bits * self.bit)
        count *= math.pow(steps / SLOPE.steps, SLOPE.growth)
        return max(1, round(min(count, self.most)))

    def worthwhile(self, losses: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which Gaussians are worth their bits, (N,); at least one of them.

        Args:
            losses: (N,) squared error that is added without each Gaussian.
        """
        chosen: NDArray[np.bool_] = losses >= SLOPE.gaussian_bits * self.bit
        chosen[losses.argmax()] = True
        return chosen
