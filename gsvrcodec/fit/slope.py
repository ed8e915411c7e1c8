"""One slope of rate and distortion: which Gaussians are worth their bits, and how many."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.fit.precision import bit_worth
from gsvrcodec.fit.tuned import SLOPE
from gsvrcodec.model.gop import Gop


@dataclass(frozen=True, slots=True)
class Slope:
    """What a bit has to save, whatever number of bits that takes."""

    qscale: float  #: of the steps that the GOP is stored with
    most: int  #: bound of the number of Gaussians
    #: how much more a bit saves than in the frames of the GOP, because others build on them
    lasting: float = 1.0

    @property
    def bit(self) -> float:
        """Squared 8-bit codes that a bit of a Gaussian has to save in the frames of the GOP."""
        return bit_worth(self.qscale) / self.lasting

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

    def worthwhile(self, gop: Gop, sensitivities: Gop) -> NDArray[np.bool_]:
        """Return which Gaussians are worth their bits, (N,); at least one of them.

        Without a Gaussian the squared error grows by the square of what it draws, unless others
        make up for it.

        Args:
            gop: The GOP to be stored.
            sensitivities: Squared error of a change of each parameter by one.
        """
        loss = (sensitivities.colour * np.square(gop.colour)).sum(axis=1)
        chosen: NDArray[np.bool_] = loss >= SLOPE.gaussian_bits * self.bit
        chosen[loss.argmax()] = True
        return chosen
