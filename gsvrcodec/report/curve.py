"""Rate-distortion curves: BD-rate, and rate at equal quality."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import exp, log

import numpy as np
from numpy.typing import NDArray

#: Halvings of the range of quality that are more than exact enough for any use.
_HALVINGS = 50


@dataclass(frozen=True, slots=True)
class BdRate:
    """Bjontegaard's mean difference in rate at equal quality."""

    percent: float  #: additional rate against the other curve, %; below 0 = less rate
    low: float  #: lowest quality that both curves have, dB
    high: float  #: highest quality that both curves have, dB


class RateCurve:
    """Rate as a function of quality, through measured points.

    The logarithm of the rate is interpolated by monotone piecewise cubics (Fritsch and Butland,
    1984), as in the BD-rate calculation of video standardisation.
    """

    def __init__(self, points: Iterable[tuple[float, float]]) -> None:
        """Make a curve from pairs of quality (dB) and rate (any unit, above 0), in any order.

        Of points of equal quality the one of least rate counts.

        Raises:
            ValueError: `points` is empty.
        """
        cheapest: dict[float, float] = {}
        for quality, rate in points:
            cheapest[quality] = min(rate, cheapest.get(quality, rate))
        if not cheapest:
            raise ValueError("a curve needs a point")
        self.quality = np.array(sorted(cheapest))
        self.log_rate = np.array([log(cheapest[quality]) for quality in self.quality.tolist()])
        self._slopes = _slopes(self.quality, self.log_rate)

    def rate(self, quality: float) -> float | None:
        """Return the rate at a quality; None = the quality is outside the measured range."""
        if not self.quality[0] <= quality <= self.quality[-1]:
            return None
        return exp(self._at(np.array([quality]))[0])

    def quality_at(self, rate: float) -> float | None:
        """Return the quality at a rate; None = the rate is outside the measured range.

        The inverse of `rate`; where the rate falls as the quality rises, one of several solutions.
        """
        wanted = log(rate)
        low, high = self.quality[0], self.quality[-1]
        if not self.log_rate[0] <= wanted <= self.log_rate[-1]:
            return None
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            low, high = (middle, high) if self._at(middle[None])[0] < wanted else (low, middle)
        return float(high)

    def bd_rate(self, other: RateCurve) -> BdRate | None:
        """Return the BD-rate of this curve against another; None = the curves do not overlap."""
        low = max(self.quality[0], other.quality[0])
        high = min(self.quality[-1], other.quality[-1])
        if low >= high:
            return None
        knots = np.concatenate([[low, high], self.quality, other.quality])
        knots = np.unique(knots[(knots >= low) & (knots <= high)])
        left, right = knots[:-1], knots[1:]
        # Simpson's rule is exact for the cubics between knots.
        ends = self._minus(other, left) + self._minus(other, right)
        middle = self._minus(other, (left + right) / 2)
        mean = float(((ends + 4 * middle) * (right - left)).sum() / 6 / (high - low))
        return BdRate(100 * (exp(mean) - 1), float(low), float(high))

    def _minus(self, other: RateCurve, quality: NDArray[np.float64]) -> NDArray[np.float64]:
        return self._at(quality) - other._at(quality)

    def _at(self, quality: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the logarithm of the rate inside the curve's range, by Hermite cubics."""
        x, y, d = self.quality, self.log_rate, self._slopes
        if len(x) == 1:
            return np.full(quality.shape, y[0])
        i = np.clip(np.searchsorted(x, quality, side="right") - 1, 0, len(x) - 2)
        width = x[i + 1] - x[i]
        t = (quality - x[i]) / width
        value = y[i] * (1 + 2 * t) * (1 - t) ** 2 + y[i + 1] * t**2 * (3 - 2 * t)
        slope = d[i] * t * (1 - t) ** 2 - d[i + 1] * t**2 * (1 - t)
        return np.asarray(value + width * slope)


def _slopes(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the derivatives at the points, chosen so that every cubic is monotone."""
    if len(x) < 3:
        return np.full(len(x), (y[-1] - y[0]) / (x[-1] - x[0]) if len(x) > 1 else 0.0)
    width = np.diff(x)
    secant = np.diff(y) / width
    slopes = np.zeros(len(x))
    same = secant[:-1] * secant[1:] > 0
    before, after = 2 * width[1:] + width[:-1], width[1:] + 2 * width[:-1]
    inverse = (before / np.where(same, secant[:-1], 1)) + (after / np.where(same, secant[1:], 1))
    slopes[1:-1] = np.where(same, (before + after) / inverse, 0)
    slopes[0] = _end_slope(width[0], width[1], secant[0], secant[1])
    slopes[-1] = _end_slope(width[-1], width[-2], secant[-1], secant[-2])
    return slopes


def _end_slope(near: float, far: float, secant: float, next_secant: float) -> float:
    """Return the derivative at an end point, by three points, limited to a monotone cubic."""
    slope = ((2 * near + far) * secant - near * next_secant) / (near + far)
    if slope * secant <= 0:
        return 0.0
    if secant * next_secant < 0 and abs(slope) > 3 * abs(secant):
        return 3 * secant
    return slope
