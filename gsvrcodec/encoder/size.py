"""A size of a file: a first pass finds the quality that meets it, GOPs make up for each other."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Self

import numpy as np

from gsvrcodec.bitstream.gop_head import parse_gop_head
from gsvrcodec.bitstream.gop_payload import coded_plate
from gsvrcodec.encoder.plan import Budget
from gsvrcodec.encoder.rate import crf_of, qscale_of
from gsvrcodec.encoder.settings import EncodeSettings, Preset
from gsvrcodec.encoder.tuned import SIZE
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
    """What the GOPs of a film take at a constant quality."""

    crf: float
    plates: tuple[int, ...]  #: bytes of plates in each GOP; none of those that an earlier one has
    others: tuple[int, ...]  #: bytes of all else in each GOP
    predicted: tuple[bool, ...]  #: whether each GOP is

    @classmethod
    def by(cls, crf: float, payloads: Iterable[bytes], *, share: bool) -> Self:
        """Measure GOPs.

        Args:
            crf: Their quality.
            payloads: Of all GOPs of the film, in order.
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
        return cls(crf, tuple(plates), tuple(others), tuple(predicted))

    @classmethod
    def from_json(cls, value: Any) -> Self | None:
        """Return what `to_json` was of; None if the JSON has another shape."""
        match value:
            case {
                "crf": float(crf),
                "plates": list(plates),
                "others": list(others),
                "predicted": list(predicted),
            }:
                return cls(crf, tuple(plates), tuple(others), tuple(predicted))
        return None

    def to_json(self) -> dict[str, Any]:
        """Return it as a JSON object."""
        return asdict(self)

    def for_size(self, room: int, share: float = 1.0) -> Self:
        """Return about what they take in so many bytes, and the quality of that.

        Args:
            room: Bytes of all GOPs.
            share: Of the bytes of `others` that they would take with more effort.
        """
        plates, others = np.array(self.plates, float), share * np.array(self.others, float)
        heads = np.minimum(others, SIZE.head_bytes)
        others -= heads
        finest, coarsest = map(crf_of, (RATE_CONTROL.finest, RATE_CONTROL.coarsest))
        crfs = np.linspace(coarsest, finest, 1 + round(100 * (coarsest - finest)))
        coarser = np.array([qscale_of(crf) for crf in crfs]) / qscale_of(self.crf)
        of_plates = plates.sum() * coarser**-SIZE.plate_power
        totals = heads.sum() + of_plates + others.sum() * coarser**-SIZE.power
        crf = float(np.interp(room, totals, crfs))
        plates *= (qscale_of(crf) / qscale_of(self.crf)) ** -SIZE.plate_power
        left = room - heads.sum() - plates.sum()
        others = heads + others * (max(0.0, left) / max(others.sum(), 1.0))
        return type(self)(crf, tuple(map(int, plates)), tuple(map(int, others)), self.predicted)

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


def first_pass(
    settings: EncodeSettings, crf: float, room: int, measure: Callable[[EncodeSettings], Taken]
) -> Taken:
    """Return about what GOPs take in so many bytes, and the quality of that.

    Between a pass of too many bytes and one of too few the next one lies as their bytes say.

    Args:
        settings: Of the encode.
        crf: A first guess of the quality.
        room: Bytes of all GOPs.
        measure: Encodes the film at a constant quality.
    """
    if settings.time_budget is not None:
        # Its number of Gaussians follows the time: it says more of shares than of the whole.
        quick = replace(settings, time_budget=SIZE.time * settings.time_budget)
        found = measure(quick.at_quality(crf)).for_size(room)
        return replace(found, crf=min(max(found.crf, crf - SIZE.near), crf + SIZE.near))
    quick = replace(settings, preset=_QUICKER[settings.preset])
    share = 1.0 if quick == settings else SIZE.effort
    most, near = SIZE.passes, SIZE.near
    known: list[tuple[int, float]] = []  # bytes that qualities take
    while True:
        taken = measure(quick.at_quality(crf))
        known.append((taken.total, crf))
        wanted = taken.for_size(room, share)
        if any(taken.plates):
            most, near = SIZE.passes_plates, SIZE.near_plates
        if len(known) == most or abs(wanted.crf - crf) < near:
            return wanted
        crf = wanted.crf
        totals, crfs = zip(*sorted(known), strict=True)
        if totals[0] < room < totals[-1]:
            crf = float(np.interp(math.log(room), np.log(totals), crfs))


class Spending:
    """Meets the size of a chain: what GOPs take too much or too little, later ones make up for.

    Args:
        planned: Bytes of each GOP at the quality of the film.
        room: Bytes that all of them may take.
    """

    def __init__(self, planned: Sequence[int], room: float) -> None:
        self._planned, self.left = list(planned), room
        self._asked = self._took = SIZE.trust * sum(planned)

    def add(self, size: int) -> None:
        """Count a GOP."""
        self._took += size * self.coarser() ** SIZE.power
        self._asked += self._planned.pop(0)
        self.left -= size

    def coarser(self) -> float:
        """Return the qscale of the next GOP / that of the film."""
        wanted = sum(self._planned) * self._took / self._asked
        factor = math.pow(max(wanted, 1) / max(self.left, 1), 1 / SIZE.power)
        factor *= SIZE.fuller if self.is_last else 1
        return min(max(1 / SIZE.reach, factor), SIZE.reach)

    @property
    def is_last(self) -> bool:
        """Whether the next GOP is the last."""
        return len(self._planned) == 1


class Rooms:
    """Shares out the bytes of a film: what plates take too much or too little, chains make up for.

    Args:
        planned: Bytes of all GOPs but for plates; 0 = any.
    """

    def __init__(self, planned: int) -> None:
        self._rest, self._spare = planned, 0.0

    def of_chain(self, budgets: Sequence[Budget], plate: int) -> float | None:
        """Return the bytes of the next chain, but for its plate; None = any.

        Args:
            budgets: Of its GOPs.
            plate: Bytes of the plate that is stored with it.
        """
        planned = sum(budget.bytes for budget in budgets)
        if not planned:
            return None
        self._spare += sum(budget.plate_bytes for budget in budgets) - plate
        more = self._spare * planned / self._rest
        self._spare -= more
        self._rest -= planned
        return planned + more
