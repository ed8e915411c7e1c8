"""Timestamps of the source, made fit for use: present, and strictly increasing."""

from __future__ import annotations

import logging
from fractions import Fraction

_log = logging.getLogger(__name__)

#: Assumed where a stream says nothing about its rate, frames a second.
DEFAULT_RATE = Fraction(25)


class Timeline:
    """Places one frame after another; repairs what is missing or runs backwards.

    A frame without a timestamp, or not later than the one before it, starts where the previous
    one ends by its stated duration, or else by the nominal frame duration.
    """

    def __init__(self, name: str, time_base: Fraction, rate: Fraction | None) -> None:
        """Start a stream called `name` in messages; `rate` in frames a second, None = unknown."""
        self._name = name
        self._rate = rate or DEFAULT_RATE
        self._nominal = max(1, round(1 / (self._rate * time_base)))
        self._pts: int | None = None
        self._duration = 0
        self._warned = False

    def place(self, pts: int | None, duration: int | None) -> int:
        """Return the timestamp of the next frame, in ticks; `duration` in ticks, 0 = unknown."""
        if pts is None or (self._pts is not None and pts <= self._pts):
            self._warn("no timestamp" if pts is None else "a timestamp out of order")
            pts = 0 if self._pts is None else self._pts + self._duration
        self._pts = pts
        self._duration = duration or self._nominal
        return pts

    def last_duration(self) -> int:
        """Return how long the frame placed last is shown, in ticks."""
        return self._duration

    def _warn(self, what: str) -> None:
        """Say once that timestamps are repaired."""
        if not self._warned:
            rate = f"{float(self._rate):.5g}"
            _log.warning("%s: %s; placed by frame duration (%s a second)", self._name, what, rate)
            self._warned = True
