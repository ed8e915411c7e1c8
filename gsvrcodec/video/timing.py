"""Timestamps of the source: choice of a part, and repair to strictly increasing times."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from fractions import Fraction
from math import isfinite

from gsvrcodec.errors import UsageError

_log = logging.getLogger(__name__)

#: Tolerance of a time in seconds against the timestamp that it stands for, ticks.
_TICK_TOLERANCE = Fraction(1, 10**6)

#: Frame rate of a stream without one, frames a second.
DEFAULT_RATE = Fraction(25)

#: Greatest frame rate, frames a second, and greatest denominator of a frame rate.
_MAX_RATE = 1000
_MAX_DENOMINATOR = 100_000


def frame_rate(rate: float | Fraction | str, name: str) -> Fraction:
    """Return a frame rate as a fraction that FFmpeg accepts.

    Args:
        rate: Frames a second; a string may be a fraction such as "30000/1001".
        name: What it is, for messages.

    Raises:
        UsageError: It is no number, or out of range.
    """
    try:
        exact = Fraction(rate).limit_denominator(_MAX_DENOMINATOR)
    except (ArithmeticError, TypeError, ValueError):  # no number, infinite, or NaN
        exact = Fraction(0)
    if not 0 < exact <= _MAX_RATE:
        raise UsageError(f"{name} must be over 0 and at most {_MAX_RATE}, not {rate}")
    return exact


@dataclass(frozen=True, slots=True)
class Span:
    """A part of a film by time, on the clock of its timestamps; half-open."""

    start: Fraction | None = None  #: seconds; None = the start of the film
    stop: Fraction | None = None  #: seconds; None = the end of the film

    def overlaps(self, start: Fraction, stop: Fraction) -> bool:
        """Return whether `start` up to `stop` overlaps the span; an instant if they are equal."""
        if self.stop is not None and start >= self.stop:
            return False
        return self.start is None or stop > self.start or start >= self.start

    def clipped(self, start: Fraction, stop: Fraction) -> tuple[Fraction, Fraction]:
        """Return `start` and `stop` clipped to the span."""
        return (
            start if self.start is None else max(start, self.start),
            stop if self.stop is None else min(stop, self.stop),
        )


@dataclass(frozen=True, slots=True)
class Part:
    """A range of frames, by number or by time; half-open."""

    start_frame: int = 0  #: first frame, from 0
    frames: int | None = None  #: number of frames; None = to the end
    start_seconds: float | Fraction | None = None  #: instead of `start_frame`
    stop_seconds: float | Fraction | None = None  #: instead of `frames`

    def __post_init__(self) -> None:
        """Check that the range is valid.

        Raises:
            UsageError: The range is invalid.
        """
        if self.start_frame < 0:
            raise UsageError(f"the first frame must be 0 or more, not {self.start_frame}")
        if self.frames is not None and self.frames < 1:
            raise UsageError(f"the number of frames must be 1 or more, not {self.frames}")
        if self.start_seconds is not None and self.start_frame:
            raise UsageError("`start_seconds` and `start_frame` exclude each other; give one")
        if self.stop_seconds is not None and self.frames is not None:
            raise UsageError("`stop_seconds` and `frames` exclude each other; give one")
        for seconds in (self.start_seconds, self.stop_seconds):
            if seconds is not None and not isfinite(seconds):
                raise UsageError(f"a time in seconds must be finite, not {seconds}")
        if (
            self.start_seconds is not None
            and self.stop_seconds is not None
            and self.start_seconds >= self.stop_seconds
        ):
            raise UsageError(
                f"`stop_seconds={float(self.stop_seconds):g}` is not after "
                f"`start_seconds={float(self.start_seconds):g}`"
            )

    def starts(self, number: int, pts: int, time_base: Fraction) -> bool:
        """Return whether frame `number`, shown at `pts`, is not before the start of the range."""
        if self.start_seconds is None:
            return number >= self.start_frame
        return pts >= _ticks(self.start_seconds, time_base)

    def ends(self, given: int, pts: int, time_base: Fraction) -> bool:
        """Return whether the range ends before the frame at `pts`, after `given` of its frames."""
        if self.stop_seconds is not None:
            return pts >= _ticks(self.stop_seconds, time_base)
        return given == self.frames


def _ticks(seconds: float | Fraction, time_base: Fraction) -> Fraction:
    """Return a time in ticks; within `_TICK_TOLERANCE` of a whole number it is rounded."""
    ticks = Fraction(seconds) / time_base
    whole = round(ticks)
    return Fraction(whole) if abs(ticks - whole) <= _TICK_TOLERANCE else ticks


class Timeline:
    """Assigns timestamps to successive frames; repairs missing and non-increasing ones.

    A frame without a timestamp, or with one not after the previous frame's, starts at the end of
    the previous frame: after its duration, or after the nominal frame duration if not known.
    """

    def __init__(self, name: str, time_base: Fraction, rate: Fraction | None) -> None:
        """Start a stream; `name` is for messages, `rate` in frames a second, None = not known."""
        self._name = name
        self._rate = rate or DEFAULT_RATE
        self._nominal = max(1, round(1 / (self._rate * time_base)))
        self._base = time_base
        self._first: int | None = None
        self._pts: int | None = None
        self._duration = 0
        self._warned = False

    def place(self, pts: int | None, duration: int | None) -> int:
        """Return the timestamp of the next frame, ticks; `duration` in ticks, 0 = not known."""
        if pts is None or (self._pts is not None and pts <= self._pts):
            self._warn("no timestamp" if pts is None else "a timestamp out of order")
            pts = 0 if self._pts is None else self._pts + self._duration
        self._pts = pts
        self._first = pts if self._first is None else self._first
        self._duration = duration or self._nominal
        return pts

    @property
    def length(self) -> Fraction:
        """Duration from the first frame to the end of the last, seconds."""
        if self._pts is None or self._first is None:
            return Fraction(0)
        return (self._pts + self._duration - self._first) * self._base

    def last_duration(self) -> int:
        """Return the duration of the last frame, ticks."""
        return self._duration

    def _warn(self, what: str) -> None:
        """Warn once that timestamps are repaired."""
        if not self._warned:
            rate = f"{float(self._rate):.5g}"
            _log.warning("%s: %s; placed by frame duration (%s a second)", self._name, what, rate)
            self._warned = True
