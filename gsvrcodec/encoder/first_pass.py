"""First passes: they find the constant quality that meets a size or a PSNR."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, ClassVar, Generic, Self, TypeAlias, TypeVar

import numpy as np

from gsvrcodec.bitstream.gop_head import parse_gop_head
from gsvrcodec.bitstream.gop_payload import coded_plate
from gsvrcodec.encoder.plan import Budget
from gsvrcodec.encoder.rate import crf_of, qscale_of
from gsvrcodec.encoder.settings import EncodeSettings, Preset
from gsvrcodec.encoder.tuned import CRF, PSNR, SIZE
from gsvrcodec.fit.target import Quality
from gsvrcodec.fit.tuned import RATE_CONTROL

#: Presets of first passes.
_QUICKER: dict[Preset, Preset] = {
    "fastest": "fastest",
    "medium": "fastest",
    "slow": "medium",
    "slowest": "slow",
}


@dataclass(frozen=True, slots=True)
class Taken:
    """What the GOPs of a film take, and reach, at a constant quality."""

    crf: float
    plates: tuple[int, ...]  #: bytes of plates in each GOP; none of those that an earlier one has
    others: tuple[int, ...]  #: bytes of all else in each GOP
    psnrs: tuple[float, ...]  #: dB, mean of the frames of each GOP
    predicted: tuple[bool, ...]  #: whether each GOP is

    @classmethod
    def by(
        cls, crf: float, payloads: Iterable[bytes], psnrs: Iterable[float], *, share: bool
    ) -> Self:
        """Measure GOPs.

        Args:
            crf: Their quality.
            payloads: Of all GOPs of the film, in order.
            psnrs: Of the same, dB.
            share: Whether a GOP may have the plate of an earlier one.
        """
        plates, others, predicted = [], [], []
        before: bytes | None = None
        for payload in payloads:
            plate = coded_plate(payload)
            size = 0 if plate is None else len(plate)
            plates.append(0 if share and plate == before else size)
            others.append(len(payload) - size)
            predicted.append(parse_gop_head(payload).reference > 0)
            before = before if plate is None else plate
        return cls(crf, tuple(plates), tuple(others), tuple(psnrs), tuple(predicted))

    @property
    def total(self) -> int:
        """Bytes of all GOPs."""
        return sum(self.plates) + sum(self.others)

    def mean_psnr(self, frames: Sequence[int]) -> float:
        """Return the mean PSNR of all frames, dB, by the number of frames of each GOP."""
        return float(np.average(self.psnrs, weights=frames))


@dataclass(frozen=True, slots=True)
class Sizes:
    """What each GOP of a film is to take."""

    crf: float
    plates: tuple[int, ...]  #: bytes of plates in each GOP; none of those that an earlier one has
    others: tuple[int, ...]  #: bytes of all else in each GOP
    predicted: tuple[bool, ...]  #: whether each GOP is

    @property
    def total(self) -> int:
        """Bytes of all GOPs."""
        return sum(self.plates) + sum(self.others)

    def budgets(self, planned: Sequence[Budget]) -> list[Budget]:
        """Return budgets of all GOPs, with the bytes of these, and predicted as these are."""
        taken = zip(planned, self.others, self.plates, self.predicted, strict=True)
        return [
            replace(budget, bytes=others, plate_bytes=plates, predicted=predicted)
            for budget, others, plates, predicted in taken
        ]


@dataclass(frozen=True, slots=True)
class Qualities:
    """Which quality each GOP of a film is to reach."""

    crf: float
    psnrs: tuple[float, ...]  #: dB, mean of the frames of each GOP
    predicted: tuple[bool, ...]  #: whether each GOP is

    def budgets(self, planned: Sequence[Budget]) -> list[Budget]:
        """Return budgets of all GOPs, with these qualities, and predicted as these are."""
        out = []
        for budget, psnr, predicted in zip(planned, self.psnrs, self.predicted, strict=True):
            assert budget.slope is not None
            target = Quality(psnr, budget.slope)
            out.append(replace(budget, target=target, predicted=predicted))
        return out


#: What each GOP of a film is to do, and the constant quality of that.
Plan: TypeAlias = Sizes | Qualities


def plan_to_json(plan: Plan) -> dict[str, Any]:
    """Return a plan as a JSON object."""
    return asdict(plan)


def plan_from_json(value: Any) -> Plan | None:
    """Return what `plan_to_json` was of; None if the JSON has another shape."""
    match value:
        case {
            "crf": float(crf),
            "plates": list(plates),
            "others": list(others),
            "predicted": list(predicted),
        }:
            return Sizes(crf, tuple(plates), tuple(others), tuple(predicted))
        case {"crf": float(crf), "psnrs": list(psnrs), "predicted": list(predicted)}:
            return Qualities(crf, tuple(psnrs), tuple(predicted))
    return None


P = TypeVar("P", Sizes, Qualities)


class Goal(ABC, Generic[P]):
    """What first passes look for."""

    __slots__ = ()

    time: ClassVar[float]  #: of a first pass / time budget

    @abstractmethod
    def miss(self, taken: Taken, *, quick: bool) -> float:
        """Return by how much a pass is too good; below 0 = too coarse.

        Args:
            taken: What its GOPs take and reach.
            quick: Whether it has less effort than the film.
        """

    @abstractmethod
    def plan(self, taken: Taken, *, quick: bool) -> P:
        """Return what the GOPs of the film are to do; arguments as of `miss`."""


@dataclass(frozen=True, slots=True)
class SizeGoal(Goal[Sizes]):
    """A size of all GOPs."""

    time = SIZE.time

    room: int  #: bytes

    def miss(self, taken: Taken, *, quick: bool) -> float:
        """Return the logarithm of the bytes that a pass takes / those that it may take."""
        return math.log(taken.total / self.room)

    def plan(self, taken: Taken, *, quick: bool) -> Sizes:
        """Return about what GOPs take in so many bytes, and the quality of that."""
        share = SIZE.effort if quick else 1.0
        plates, others = np.array(taken.plates, float), share * np.array(taken.others, float)
        heads = np.minimum(others, SIZE.head_bytes)
        others -= heads
        finest, coarsest = map(crf_of, (RATE_CONTROL.finest, RATE_CONTROL.coarsest))
        crfs = np.linspace(coarsest, finest, 1 + round(100 * (coarsest - finest)))
        coarser = np.array([qscale_of(crf) for crf in crfs]) / qscale_of(taken.crf)
        of_plates = plates.sum() * coarser**-SIZE.plate_power
        totals = heads.sum() + of_plates + others.sum() * coarser**-SIZE.power
        crf = float(np.interp(self.room, totals, crfs))
        plates *= (qscale_of(crf) / qscale_of(taken.crf)) ** -SIZE.plate_power
        left = self.room - heads.sum() - plates.sum()
        others = heads + others * (max(0.0, left) / max(others.sum(), 1.0))
        return Sizes(crf, tuple(map(int, plates)), tuple(map(int, others)), taken.predicted)


@dataclass(frozen=True, slots=True)
class PsnrGoal(Goal[Qualities]):
    """A mean PSNR of all frames."""

    time = PSNR.time

    decibels: float
    frames: tuple[int, ...]  #: of each GOP

    def miss(self, taken: Taken, *, quick: bool) -> float:
        """Return the dB that the film would have more than it is to have."""
        return taken.mean_psnr(self.frames) + PSNR.effort * quick - self.decibels

    def plan(self, taken: Taken, *, quick: bool) -> Qualities:
        """Return about the quality of each GOP at this mean, and the quality of all."""
        coarser = self.miss(taken, quick=quick) / PSNR.crf_step
        crf = min(max(0.0, taken.crf + coarser), CRF.highest)
        more = self.decibels - taken.mean_psnr(self.frames)
        return Qualities(crf, tuple(psnr + more for psnr in taken.psnrs), taken.predicted)


def first_pass(
    settings: EncodeSettings, crf: float, goal: Goal[P], measure: Callable[[EncodeSettings], Taken]
) -> P:
    """Return what GOPs are to do to meet a goal, and the quality of that.

    After a pass that is too good and one that is too coarse the next one lies between them.

    Args:
        settings: Of the encode.
        crf: A first guess of the quality.
        goal: What is to be met.
        measure: Encodes the film at a constant quality.
    """
    if settings.time_budget is not None:
        # Its number of Gaussians follows the time: it says more of shares than of the whole.
        less = replace(settings, time_budget=goal.time * settings.time_budget)
        found = goal.plan(measure(less.at_quality(crf)), quick=False)
        return replace(found, crf=min(max(found.crf, crf - SIZE.near), crf + SIZE.near))
    preset = _QUICKER[settings.preset]
    quick = preset != settings.preset
    most, near = SIZE.passes, SIZE.near
    known: list[tuple[float, float]] = []  # misses of qualities
    while True:
        taken = measure(replace(settings, preset=preset).at_quality(crf))
        known.append((goal.miss(taken, quick=quick), crf))
        plan = goal.plan(taken, quick=quick)
        between = _between(known)
        # The bytes of a plan of sizes are those of its own quality.
        if between is not None and isinstance(plan, Qualities):
            plan = replace(plan, crf=between)
        if any(taken.plates):
            most, near = SIZE.passes_plates, SIZE.near_plates
        if len(known) == most or abs(plan.crf - crf) < near:
            return plan
        crf = plan.crf if between is None else between


def _between(known: Sequence[tuple[float, float]]) -> float | None:
    """Return the quality between one too good and one too coarse; None = one of them lacks.

    Args:
        known: Misses of qualities, and these.
    """
    misses, crfs = zip(*sorted(known), strict=True)
    return float(np.interp(0, misses, crfs)) if misses[0] < 0 < misses[-1] else None
