"""The qscale of all steps of a GOP: fixed, or what meets a size or a quality."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from gsvrcodec.fit.tuned import RATE_CONTROL

#: What a size may fall short by, and how far a quality may be missed (dB).
_SIZE_TOLERANCE = 0.004
_PSNR_TOLERANCE = 0.02
#: A qscale of e saves a fifth of the bits, and costs some quality (dB).
_SIZE_FALL, _PSNR_FALL = 0.2, 1.0
_MOST_TRIALS = 12
#: Bounds of a stride towards a value that is still on the same side.
_STRIDES = 0.1, 1.2


@dataclass(frozen=True, slots=True)
class Target:
    """A value that falls as the qscale grows, and how near to it is near enough."""

    value: float
    below: float  #: how much less will do
    above: float  #: how much more will do
    fall: float  #: how much it falls, or so, when the qscale grows by e

    @classmethod
    def of_size(cls, size: int) -> Target:
        """At most `size` bytes, and nearly as many."""
        return cls(float(size), _SIZE_TOLERANCE * size, 0.0, _SIZE_FALL * size)

    @classmethod
    def of_psnr(cls, psnr: float) -> Target:
        """About `psnr` dB."""
        return cls(psnr, _PSNR_TOLERANCE, _PSNR_TOLERANCE, _PSNR_FALL)


def find_qscale(measure: Callable[[float], float], target: Target, first: float) -> float:
    """The qscale at which `measure` comes to the target.

    It is sought by false position over the qscale's logarithm, halving where that stalls. If the
    target is out of reach, the nearest qscale of the range is given.

    Args:
        measure: size or quality at a qscale; falls as the qscale grows.
        target: what it is to come to.
        first: where to begin.
    """
    low = high = None  # (log qscale, miss): low is fine and above the target, high below it
    at, push = math.log(first), 1.1
    for trial in range(_MOST_TRIALS):
        miss = measure(math.exp(at)) - target.value
        if -target.below <= miss <= target.above:
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
            share = low[1] / (low[1] - high[1]) if trial % 3 else 0.5
            at = low[0] + min(max(share, 0.05), 0.95) * (high[0] - low[0])
    return math.exp(high[0] if high else at)
