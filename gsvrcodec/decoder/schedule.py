"""Which pictures of a film to make, and when each of them is shown."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from math import ceil, gcd, isfinite
from typing import NamedTuple, Protocol

from gsvrcodec.decoder.decoder import Decoder
from gsvrcodec.errors import UsageError
from gsvrcodec.render import Codes

#: Rates of containers are fractions of 32-bit numbers.
_MAX_DENOMINATOR = 100_000

#: The most frames a second, and the fastest speed.
_MAX_RATE = 1000

#: A time in seconds or a rate; the fraction for values that no float hits.
Number = float | Fraction


class TimedPicture(NamedTuple):
    """A picture and when it is shown."""

    data: Codes  #: (H, W, 3)
    pts: int  #: ticks of the schedule
    duration: int  #: ticks; 0 = not known


class Schedule(Protocol):
    """The pictures to make, in order."""

    @property
    def total(self) -> int:
        """How many pictures there are."""

    @property
    def first_frame(self) -> int:
        """Number of the first picture, from 0."""

    @property
    def time_base(self) -> Fraction:
        """Seconds a tick."""

    @property
    def rate(self) -> Fraction:
        """Pictures a second, mean."""

    @property
    def start(self) -> Fraction:
        """When the part of the film starts that is shown, seconds of the film."""

    @property
    def stop(self) -> Fraction:
        """When that part ends, seconds of the film."""

    @property
    def speed(self) -> Fraction:
        """Seconds of the film that pass in one second."""

    def pictures(self, decoder: Decoder) -> Iterator[TimedPicture]:
        """Make the pictures; a decoder that keeps going leaves out those that are damaged."""


@dataclass(frozen=True, slots=True)
class StoredFrames:
    """Frames as the file has them, at their own times."""

    frames: range  #: their numbers
    start: Fraction  #: of the part to show, seconds
    stop: Fraction  #: of the part to show, not included, seconds
    time_base: Fraction
    rate: Fraction
    speed = Fraction(1)

    @property
    def total(self) -> int:
        """How many pictures there are."""
        return len(self.frames)

    @property
    def first_frame(self) -> int:
        """Number of the first frame, from 0."""
        return self.frames.start

    def pictures(self, decoder: Decoder) -> Iterator[TimedPicture]:
        """Make the pictures."""
        for frame in decoder.frames(self.frames.start, self.frames.stop):
            yield TimedPicture(frame.data, frame.pts, frame.duration)


@dataclass(frozen=True, slots=True)
class SteadyRate:
    """Pictures at a constant rate, made at the times when they are due, between frames too."""

    start: Fraction  #: of the part to show, seconds
    stop: Fraction  #: of the part to show, not included, seconds
    rate: Fraction
    speed: Fraction  #: seconds of the film that pass in one second
    first_frame = 0

    @property
    def total(self) -> int:
        """How many pictures there are."""
        return ceil((self.stop - self.start) * self.rate / self.speed)

    @property
    def time_base(self) -> Fraction:
        """Seconds a tick: the longest tick that all times are multiples of."""
        first, step = self.start / self.speed, 1 / self.rate
        a, b = first.numerator * step.denominator, step.numerator * first.denominator
        return Fraction(gcd(a, b), first.denominator * step.denominator)

    def pictures(self, decoder: Decoder) -> Iterator[TimedPicture]:
        """Make the pictures."""
        first = int(self.start / self.speed / self.time_base)
        step = int(1 / self.rate / self.time_base)
        times = (self.start + n * self.speed / self.rate for n in range(self.total))
        for number, picture in decoder.rendered(times):
            yield TimedPicture(picture, first + number * step, step)


def schedule(
    decoder: Decoder,
    *,
    start_frame: int = 0,
    frames: int | None = None,
    start_seconds: Number | None = None,
    stop_seconds: Number | None = None,
    fps: Number | None = None,
    speed: Number = 1,
) -> Schedule:
    """Return the pictures to make of a part of the film; see `gsvrcodec.decode`.

    Raises:
        UsageError: the part is empty, is given twice, or a rate makes no sense.
        CorruptError: the part begins or ends in a damaged GOP.
    """
    if start_seconds is not None and start_frame:
        raise UsageError("`start_seconds` and `start_frame` exclude each other; give one")
    if stop_seconds is not None and frames is not None:
        raise UsageError("`stop_seconds` and `frames` exclude each other; give one")
    length, meta = len(decoder), decoder.metadata
    if not 0 <= start_frame < length:
        raise UsageError(f"frame {start_frame} is out of range: the video has {length} frames")
    if frames is not None and frames < 1:
        raise UsageError(f"the number of frames must be 1 or more, not {frames}")
    first, start = start_frame, meta.begin_seconds
    if start_seconds is not None:
        start = max(_seconds(decoder, start_seconds), start)
        first = decoder.first_frame_from(start)
    elif start_frame:
        start = decoder.starts_at(start_frame)
    last, stop = length, meta.end_seconds
    if stop_seconds is not None:
        stop = min(_seconds(decoder, stop_seconds), stop)
        last = decoder.first_frame_from(stop)
    elif frames is not None and first + frames < length:
        last = first + frames
        stop = decoder.starts_at(last)
    pace = _rate(speed, "speed")
    if fps is not None or pace != 1:
        if start >= stop:
            raise UsageError(f"nothing is shown in this part: {meta.span}")
        rate = _rate(meta.average_rate if fps is None else fps, "frame rate")
        return SteadyRate(start, stop, rate, pace)
    if first >= last:
        raise UsageError(f"no frame starts in this part: {meta.span}")
    rate = meta.average_rate.limit_denominator(_MAX_DENOMINATOR)
    return StoredFrames(range(first, last), start, stop, meta.time_base, rate)


def _seconds(decoder: Decoder, seconds: Number) -> Fraction:
    """Return a time as it can be reckoned with, whole ticks if it is all but that."""
    if not isfinite(seconds):
        raise UsageError(f"a time in seconds must be finite, not {seconds}")
    return decoder.metadata.ticks(seconds) * decoder.metadata.time_base


def _rate(value: Number, what: str) -> Fraction:
    """Return a rate as a fraction of numbers that containers can hold."""
    if not (isfinite(value) and 0 < value <= _MAX_RATE):
        raise UsageError(f"the {what} must be over 0 and at most {_MAX_RATE}, not {value}")
    rate = Fraction(value).limit_denominator(_MAX_DENOMINATOR)
    if not rate:
        raise UsageError(f"the {what} must be at least 1/{_MAX_DENOMINATOR}, not {value}")
    return rate
