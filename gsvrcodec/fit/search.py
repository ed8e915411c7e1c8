"""The qscale that meets a size or a quality."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeVar

from gsvrcodec.fit.tuned import RATE_CONTROL

#: Fraction by which a size may fall short, and dB by which a quality may be missed.
_SIZE_TOLERANCE = 0.004
_PSNR_TOLERANCE = 0.02
#: Slopes to begin with: a qscale e times as large saves 30 % of the bits and costs 1 dB.
_SIZE_FALL, _PSNR_FALL = 0.3, 1.0
_MOST_TRIALS = 12
_MOST_ROUNDINGS = 4
#: Shortest and longest stride of the logarithm while the target is not bracketed.
_STRIDES = 0.01, 1.2


@dataclass(frozen=True, slots=True)
class Goal:
    """A value that falls as the qscale grows, and its tolerance."""

    value: float
    below: float  #: tolerance below the value
    above: float  #: tolerance above the value
    fall: float  #: about how much the value falls when the qscale grows by a factor of e

    @classmethod
    def of_size(cls, size: int) -> Goal:
        """At most `size` bytes, and nearly as many."""
        return cls(float(size), _SIZE_TOLERANCE * size, 0.0, _SIZE_FALL * size)

    @classmethod
    def of_psnr(cls, psnr: float) -> Goal:
        """About `psnr` dB."""
        return cls(psnr, _PSNR_TOLERANCE, _PSNR_TOLERANCE, _PSNR_FALL)


def find_qscale(measure: Callable[[float], float], target: Goal, first: float) -> float:
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


class Result(Protocol):
    """A quantised fit."""

    @property
    def psnr(self) -> float:
        """PSNR of the decoded frames, dB."""


R = TypeVar("R", bound=Result)


class Candidate(Protocol[R]):
    """A fit that can be quantised at any qscale."""

    @property
    def psnr(self) -> float:
        """PSNR before quantisation, dB."""

    @property
    def usual_qscale(self) -> float:
        """A qscale to begin with."""

    def size(self, qscale: float, *, exact: bool = False) -> int:
        """Bytes before tuning; not `exact` = a quick estimate from above."""

    def quality(self, qscale: float) -> float:
        """PSNR before tuning, dB."""

    def quantised(self, qscale: float, *, trials: int = 1) -> R:
        """Round and tune; `trials` calls share a wall time."""

    def stored_bytes(self, result: R) -> int:
        """Bytes of what `quantised` returned."""


def quantise_to_size(candidate: Candidate[R], target_bytes: int, qscale: float) -> R:
    """Quantise so that the payload takes at most `target_bytes`, and nearly as many.

    It takes fewer where more of them would win next to nothing. If tuning adds more bytes than were
    kept free for it, as it may to a small GOP, the GOP is rounded again, to coarser steps.

    Args:
        candidate: a fit.
        target_bytes: of the payload.
        qscale: to begin with.
    """
    wanted = round((1 - RATE_CONTROL.size_room) * target_bytes)
    qscale = find_qscale(candidate.size, Goal.of_size(wanted), qscale)
    wanted += candidate.size(qscale) - candidate.size(qscale, exact=True)
    for trial in range(_MOST_ROUNDINGS):
        qscale = find_qscale(candidate.size, Goal.of_size(wanted), qscale)
        found = candidate.quantised(max(qscale, _finest(candidate)))
        over, before = candidate.stored_bytes(found) - target_bytes, candidate.size(qscale)
        if over <= 0 or before > wanted:  # met, or out of reach
            break
        wanted = before - (1 + trial) * over
    return found


def _finest(candidate: Candidate[R]) -> float:
    """Return the qscale below which bits buy next to nothing."""
    return RATE_CONTROL.finest_usual * candidate.usual_qscale


def quantise_to_psnr(candidate: Candidate[R], target_psnr: float, qscale: float) -> R:
    """Quantise so that the decoded frames come to about `target_psnr`, dB, after tuning.

    Of all trials the nearest is returned. Once one is above and another below, the next lies
    between them. Where the quality is out of reach it is not paid for by ever finer steps.

    Args:
        candidate: a fit.
        target_psnr: dB.
        qscale: to begin with; the others are at most `RATE_CONTROL.reach` times as large or small.
    """
    low = max(qscale / RATE_CONTROL.reach, RATE_CONTROL.finest)
    high = min(qscale * RATE_CONTROL.reach, RATE_CONTROL.coarsest)
    misses: list[float] = []
    qscales: list[float] = []
    for _ in range(RATE_CONTROL.tunings):
        result = candidate.quantised(qscale, trials=RATE_CONTROL.tunings)
        misses.append(result.psnr - target_psnr)
        qscales.append(qscale)
        if abs(misses[-1]) == min(map(abs, misses)):
            nearest = result
        if abs(misses[-1]) < RATE_CONTROL.near:
            break
        found = _between(misses, qscales)
        if found is None:
            rounding = max(candidate.psnr - candidate.quality(qscale), 1e-3)
            left = min(max(0.2, (candidate.psnr - result.psnr) / rounding), 1.0)
            loss = max(0.0, candidate.psnr - target_psnr) / left
            found = find_qscale(candidate.quality, Goal.of_psnr(candidate.psnr - loss), qscale)
        qscale = min(max(found, low), high)
        if qscale == qscales[-1]:  # out of reach
            break
    return nearest


def _between(misses: list[float], qscales: list[float]) -> float | None:
    """Return a qscale between the coarsest trial above and the finest below; None = one lacks."""
    tried = list(zip(qscales, misses, strict=True))
    below = min((one for one in tried if one[1] < 0), default=None)
    above = max((one for one in tried if one[1] > 0), default=None)
    if below is None or above is None:
        return None
    share = below[1] / (below[1] - above[1])
    between: float = below[0] * (above[0] / below[0]) ** share
    return between
