"""Rate control of one GOP: the qscale and the number of Gaussians that meet a size or a PSNR.

Nothing here renders: a fit is known by the two protocols below.
"""

from __future__ import annotations

from collections.abc import Callable
from statistics import fmean
from typing import Protocol, TypeVar

from gsvrcodec.fit.target import Target, find_qscale
from gsvrcodec.fit.tuned import RATE_CONTROL


class Result(Protocol):
    """A quantised fit."""

    @property
    def psnr(self) -> float:
        """PSNR of the decoded frames, dB."""


R = TypeVar("R", bound=Result, covariant=True)


class Candidate(Protocol[R]):
    """A fit that can be quantised at any qscale."""

    @property
    def psnr(self) -> float:
        """PSNR before quantisation, dB."""

    @property
    def usual_qscale(self) -> float:
        """A qscale to begin with."""

    @property
    def is_tuned(self) -> bool:
        """Whether `quantised` tunes, which wins back a part of the quantisation loss."""

    def size(self, qscale: float, *, exact: bool = False) -> int:
        """Bytes before tuning; not `exact` = a quick estimate from above."""

    def quality(self, qscale: float) -> float:
        """PSNR before tuning, dB."""

    def quantised(self, qscale: float, *, trials: int = 1) -> R:
        """Round and tune; `trials` calls share a wall time."""


class Trial(Protocol):
    """A fit by its number of Gaussians."""

    @property
    def psnr(self) -> float:
        """PSNR before quantisation, dB."""

    @property
    def steps(self) -> float:
        """Optimiser steps of the fit."""


F = TypeVar("F", bound=Trial)


def quantise_to_size(candidate: Candidate[R], target_bytes: int) -> R:
    """Quantise so that the payload takes at most `target_bytes`, and nearly as many.

    It takes fewer where more of them would win next to nothing.
    """
    wanted = round((1 - RATE_CONTROL.size_room) * target_bytes)
    qscale = find_qscale(candidate.size, Target.of_size(wanted), candidate.usual_qscale)
    excess = candidate.size(qscale) - candidate.size(qscale, exact=True)
    if excess:
        qscale = find_qscale(candidate.size, Target.of_size(wanted + excess), qscale)
    return candidate.quantised(max(qscale, _finest(candidate)))


def quantise_near_size(
    candidate: Candidate[R], target_bytes: int, qscale: float, reach: float
) -> R:
    """Quantise so that the payload takes about `target_bytes`; what is missed, others make up for.

    Args:
        candidate: a fit.
        target_bytes: of the payload.
        qscale: the qscale to begin with.
        reach: factor by which the qscale may differ from that; by more only if the payload takes
            far too many bytes else.
    """
    miss = candidate.size(qscale) / target_bytes
    factor, enough = (
        (miss / excess) ** (1 / RATE_CONTROL.size_power) for excess in (1.0, RATE_CONTROL.excess)
    )
    wanted = qscale * max(min(max(factor, 1 / reach), reach), enough)
    return candidate.quantised(min(max(wanted, _finest(candidate)), RATE_CONTROL.coarsest))


def _finest(candidate: Candidate[R]) -> float:
    """Return the qscale below which bits buy next to nothing."""
    return RATE_CONTROL.finest_usual * candidate.usual_qscale


def quantise_to_psnr(candidate: Candidate[R], target_psnr: float) -> R:
    """Quantise so that the decoded frames come to about `target_psnr`, dB, after tuning.

    Of all trials the nearest is returned. Once one is above and another below, the next lies
    between them.
    """
    left = RATE_CONTROL.loss_left if candidate.is_tuned else 1.0
    trials = RATE_CONTROL.tunings if candidate.is_tuned else 1
    qscale = candidate.usual_qscale
    misses: list[float] = []
    qscales: list[float] = []
    for _ in range(trials):
        loss = max(0.0, candidate.psnr - target_psnr) / left
        wanted = Target.of_psnr(candidate.psnr - loss)
        qscale = _between(misses, qscales) or find_qscale(candidate.quality, wanted, qscale)
        result = candidate.quantised(qscale, trials=trials)
        misses.append(result.psnr - target_psnr)
        qscales.append(qscale)
        if abs(misses[-1]) == min(map(abs, misses)):
            nearest = result
        if abs(misses[-1]) < RATE_CONTROL.near or not loss:
            break
        left = min(max(0.2, (candidate.psnr - result.psnr) / loss), 1.0)
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


def fit_to_psnr(
    fit: Callable[[int, float], F],
    target_psnr: float,
    gaussians: int,
    most: int,
    *,
    refits: int = RATE_CONTROL.refits,
) -> F:
    """Find the number of Gaussians whose fit suits `target_psnr`, and return that fit.

    A pilot of a part of the effort tells the number; whole fits follow until one has a sensible
    quantisation loss to spare.

    Args:
        fit: makes a fit of N Gaussians with a fraction of the effort.
        target_psnr: dB, of the decoded frames.
        gaussians: a first guess.
        most: bound of N.
        refits: whole fits after the first; 0 = keep the first, as under a time budget.
    """
    aim = fmean(RATE_CONTROL.spare)

    def more(count: int, gain: float) -> int:
        """Gaussians that would reach `gain` dB more."""
        octaves = min(max(gain, -9.0), 9.0) / RATE_CONTROL.octave
        return min(max(1, round(count * 2**octaves)), most)

    pilot = fit(gaussians, RATE_CONTROL.pilot)
    scale, power = RATE_CONTROL.deficit
    reachable = pilot.psnr + scale * pilot.steps**power
    gaussians = more(gaussians, target_psnr + RATE_CONTROL.rounding_loss + aim - reachable)
    found = fit(gaussians, 1.0)
    for _ in range(refits):
        spare = found.psnr - target_psnr - RATE_CONTROL.rounding_loss
        better = more(gaussians, aim - spare)
        if RATE_CONTROL.spare[0] <= spare <= RATE_CONTROL.spare[1] or better == gaussians:
            break
        gaussians = better
        found = fit(gaussians, 1.0)
    return found
