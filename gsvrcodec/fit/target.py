"""Search for the qscale of a GOP that meets a size or a quality."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from gsvrcodec.fit.tuned import RATE_CONTROL

#: Fraction by which a size may fall short, and dB by which a quality may be missed.
_SIZE_TOLERANCE = 0.004
_PSNR_TOLERANCE = 0.02
#: Slopes to begin with: a qscale e times as large saves 30 % of the bits and costs 1 dB.
_SIZE_FALL, _PSNR_FALL = 0.3, 1.0
_MOST_TRIALS = 12
#: Shortest and longest stride of the logarithm while the target is not bracketed.
_STRIDES = 0.01, 1.2


@dataclass(frozen=True, slots=True)
class Target:
    """A value that falls as the qscale grows, and its tolerance."""

    value: float
    below: float  #: tolerance below the value
    above: float  #: tolerance above the value
    fall: float  #: about how much the value falls when the qscale grows by a factor of e

    @classmethod
    def of_size(cls, size: int) -> Target:
        """At most `size` bytes, and nearly as many."""
        return cls(float(size), _SIZE_TOLERANCE * size, 0.0, _SIZE_FALL * size)

    @classmethod
    def of_psnr(cls, psnr: float) -> Target:
        """About `psnr` dB."""
        return cls(psnr, _PSNR_TOLERANCE, _PSNR_TOLERANCE, _PSNR_FALL)


def find_qscale(measure: Callable[[float], float], target: Target, first: float) -> float:
    """Return the qscale at which `measure` meets the target.

    The search is false position over the logarithm of the qscale, with bisection where that
    stalls. Where the value jumps over the target, the qscale below the target is returned; if the
    target is out of reach, the nearest end of the range.

    Args:
        measure: size or quality at a qscale; falls as the qscale grows.
        target: the value to meet.
        first: qscale to begin with.
    """
    low = high = None  # (log qscale, miss): `low` lies above the target, `high` below it
    at, push = math.log(first), 1.0
    middle = target.value + (target.above - target.below) / 2
    reach = (target.above + target.below) / 2
    for trial in range(_MOST_TRIALS):
        miss = measure(math.exp(at)) - middle
        if abs(miss) <= reach:
            return math.exp(at)
        if miss > 0:
            low = at, miss
        else:
            high = at, miss
        if low is None or high is None:
            edge = math.log(RATE_CONTROL.coarsest if miss > 0 else RATE_CONTROL.finest)
            if at == edge:
                return math.exp(at)
            stride = min(max(push * abs(miss) / target.fall, _STRIDES[0]), _STRIDES[1])
            at = min(at + stride, edge) if miss > 0 else max(at - stride, edge)
            push *= 2
        else:
            if (high[0] - low[0]) * target.fall < target.below / 4:
                break  # the value jumps here, because steps are rounded
            share = low[1] / (low[1] - high[1]) if trial % 3 else 0.5
            at = low[0] + min(max(share, 0.05), 0.95) * (high[0] - low[0])
    return math.exp(high[0] if high else at)
