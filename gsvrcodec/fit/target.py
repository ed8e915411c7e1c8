"""Targets of a GOP: a number of Gaussians, a size, a quality, a slope of rate and distortion.

A target knows how many Gaussians are fitted for it, and at which qscale the fit is stored.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.fit.search import Candidate, R, quantise_to_psnr, quantise_to_size
from gsvrcodec.fit.tuned import RATE_CONTROL, SLOPE, STEPS


class Target(ABC):
    """What the encode of one GOP aims at."""

    __slots__ = ()

    #: Whether several qscales are tried before a fit is stored.
    searches: ClassVar[bool] = False

    @abstractmethod
    def quantise(self, candidate: Candidate[R], before: float | None) -> R:
        """Store a fit.

        Args:
            candidate: The fit.
            before: Qscale of the GOP that it is predicted from; None = a key GOP.
        """


@dataclass(frozen=True, slots=True)
class Count(Target):
    """So many Gaussians, at the usual qscale."""

    def quantise(self, candidate: Candidate[R], before: float | None) -> R:
        """Store at the qscale of the GOP before, or at the usual one."""
        return candidate.quantised(candidate.usual_qscale if before is None else before)


@dataclass(frozen=True, slots=True)
class Slope(Target):
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

    def at(self, stored_qscale: float) -> Slope:
        """Return the slope that is stored at a qscale."""
        return replace(self, qscale=stored_qscale / self.stored_qscale * self.qscale)

    def quantise(self, candidate: Candidate[R], before: float | None) -> R:
        """Store at the qscale of the slope."""
        return candidate.quantised(self.stored_qscale)

    def gaussians(
        self, pixels: int, error: float, steps: float, moving: float, fitted: float = math.inf
    ) -> int:
        """Return the number of Gaussians at which one more would save just enough.

        Args:
            pixels: Of all frames that show the GOP.
            error: Mean squared error so far, 8-bit codes.
            steps: Of the whole fit; each Gaussian is worth more after many of them.
            moving: Share of the Gaussians that move.
            fitted: Gaussians that the time of the fit suffices for, by `SLOPE`'s times of each.
                Where the slope wants many times as many, there are more: they pay even half fitted.
        """
        count = SLOPE.fall * error * pixels / (_gaussian_bits(moving) * self.bit)
        count *= math.pow(steps / SLOPE.steps, SLOPE.growth)
        time = SLOPE.still_time * (1 - moving) + SLOPE.moving_time * moving
        bound = fitted / time
        if count > SLOPE.scarce * bound:
            bound = math.sqrt(bound * count / SLOPE.scarce)
        return max(1, round(min(count, self.most, bound)))

    def paid(self, losses: NDArray[np.float64], moving: float) -> float:
        """Return how well Gaussians that have come pay for their bits; 1 = as is usual.

        Args:
            losses: Squared error that is added without each of them; one at least.
            moving: Share of the Gaussians that move.
        """
        usual, (low, high) = SLOPE.paid_usual * _gaussian_bits(moving) * self.bit, SLOPE.paid_range
        worth = float(np.median(losses)) / usual if usual else math.inf
        return min(max(low, math.pow(worth, SLOPE.paid_power)), high)

    def worthwhile(
        self, losses: NDArray[np.float64], moving: NDArray[np.bool_]
    ) -> NDArray[np.bool_]:
        """Return which Gaussians are worth their bits, (N,); at least one of them.

        Args:
            losses: (N,) squared error that is added without each Gaussian.
            moving: (N,) which of them move.
        """
        bits = np.where(moving, _gaussian_bits(1.0), _gaussian_bits(0.0))
        chosen: NDArray[np.bool_] = losses >= bits * self.bit
        chosen[losses.argmax()] = True
        return chosen


@dataclass(frozen=True, slots=True)
class Size(Target):
    """A size of the payload, for a fit by a slope that takes about as much."""

    searches = True

    bytes: int
    slope: Slope

    def quantise(self, candidate: Candidate[R], before: float | None) -> R:
        """Store at the qscale that meets the size."""
        return quantise_to_size(candidate, self.bytes, self.slope.stored_qscale)


@dataclass(frozen=True, slots=True)
class Quality(Target):
    """A mean PSNR of the decoded frames, for a fit by a slope that comes to about that."""

    searches = True

    psnr: float  #: dB
    slope: Slope

    def quantise(self, candidate: Candidate[R], before: float | None) -> R:
        """Store at the qscale that meets the quality."""
        return quantise_to_psnr(candidate, self.psnr, self.slope.stored_qscale)

    def finer(self, psnr: float) -> Self | None:
        """Return the target with a finer slope, for a fit that has too low a PSNR; else None.

        Args:
            psnr: Of the fit before it is stored, dB.
        """
        short = self.psnr + RATE_CONTROL.rounding - psnr
        if short <= 0:
            return None
        octaves = (short + RATE_CONTROL.spare) / RATE_CONTROL.octave
        qscale = max(self.slope.qscale / 2**octaves, RATE_CONTROL.finest)
        return replace(self, slope=replace(self.slope, qscale=qscale))


def _gaussian_bits(moving: float) -> float:
    """Bits that a Gaussian takes in the mean, where a share of them moves."""
    return SLOPE.gaussian_bits + moving * SLOPE.motion_bits


def bit_worth(qscale: float) -> float:
    """Squared 8-bit codes that a bit has to save at a qscale: the slope of all steps."""
    return 2 * math.log(2) * STEPS.unit * qscale**2
