"""A size of a file: its GOPs, and its chains, make up for what others take."""

from __future__ import annotations

import math
from collections.abc import Sequence

from gsvrcodec.encoder.plan import Budget
from gsvrcodec.encoder.tuned import SIZE


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
