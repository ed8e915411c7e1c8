"""Schedule of an export: which pictures to render, with which timestamps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from math import ceil, gcd, isfinite
from typing import NamedTuple, Protocol

from gsvrcodec.decoder.decoder import Decoder
from gsvrcodec.errors import UsageError
from gsvrcodec.render import Codes

#: Greatest denominator of a rate; containers store rates as fractions of 32-bit numbers.
_MAX_DENOMINATOR = 100_000

#: Greatest frame rate, frames a second, and greatest speed.
_MAX_RATE = 1000

#: A time in seconds or a rate; a fraction for values that a float cannot express.
Number = float | Fraction


class TimedPicture(NamedTuple):
    """A picture with its timestamp and duration."""

    data: Codes  #: (H, W, 3)
    pts: int  #: ticks of the schedule's time base
    duration: int  #: ticks; 0 = not known


class Schedule(Protocol):
    """The pictures to render, in order."""

    @property
    def total(self) -> int | None:
        """Number of pictures; None = not known yet."""

    @property
    def first_frame(self) -> int:
        """Number of the first picture, from 0."""

    @property
    def time_base(self) -> Fraction:
        """Seconds a tick."""

    @property
    def rate(self) -> Fraction:
        """Mean frame rate, pictures a second."""

    @property
    def start(self) -> Fraction:
        """Start of the chosen part, seconds of the film."""

    @property
    def stop(self) -> Fraction:
        """End of the chosen part, not included, seconds of the film."""

    @property
    def speed(self) -> Fraction:
        """Seconds of the film in one second of the output."""

    def pictures(self, decoder: Decoder) -> Iterator[TimedPicture]:
        """Render the pictures; with `keep_going` the decoder leaves out damaged ones."""


@dataclass(frozen=True, slots=True)
class ComingFrames:
    """All stored frames at their own timestamps, as they come by a pipe."""

    start: Fraction  #: start of the video, seconds
    stop: Fraction  #: end of what came so far, seconds
    time_base: Fraction
    rate: Fraction
    total = None
    first_frame = 0
    speed = Fraction(1)

    def pictures(self, decoder: Decoder) -> Iterator[TimedPicture]:
        """Render the pictures."""
        for frame in decoder.frames():
            yield TimedPicture(frame.data, frame.pts, frame.duration)


@dataclass(frozen=True, slots=True)
class StoredFrames:
    """The stored frames at their own timestamps."""

    frames: range  #: frame numbers
    start: Fraction  #: start of the chosen part, seconds of the film
    stop: Fraction  #: end of the chosen part, not included, seconds of the film
    time_base: Fraction
    rate: Fraction
    speed = Fraction(1)

    @property
    def total(self) -> int:
        """Number of pictures."""
        return len(self.frames)

    @property
    def first_frame(self) -> int:
        """Number of the first frame, from 0."""
        return self.frames.start

    def pictures(self, decoder: Decoder) -> Iterator[TimedPicture]:
        """Render the pictures."""
        for frame in decoder.frames(self.frames.start, self.frames.stop):
            yield TimedPicture(frame.data, frame.pts, frame.duration)


@dataclass(frozen=True, slots=True)
class SteadyRate:
    """Pictures at a constant rate, each rendered at its own time, also between stored frames."""

    start: Fraction  #: start of the chosen part, seconds of the film
    stop: Fraction  #: end of the chosen part, not included, seconds of the film
    rate: Fraction
    speed: Fraction  #: seconds of the film in one second of the output
    first_frame = 0

    @property
    def total(self) -> int:
        """Number of pictures."""
        return ceil((self.stop - self.start) * self.rate / self.speed)

    @property
    def time_base(self) -> Fraction:
        """Seconds a tick: the longest tick of which all timestamps are multiples."""
        first, step = self.start / self.speed, 1 / self.rate
        a, b = first.numerator * step.denominator, step.numerator * first.denominator
        return Fraction(gcd(a, b), first.denominator * step.denominator)

    def pictures(self, decoder: Decoder) -> Iterator[TimedPicture]:
        """Render the pictures."""
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
    """Return the schedule of a part of the film; arguments as of `gsvrcodec.decode`.

    A part of a pipe, or other times than those of its frames, wait for its end.

    Raises:
        UsageError: The part is empty or given twice, or a rate is out of range.
        CorruptError: The part starts or ends in a damaged GOP.
    """
    if start_seconds is not None and start_frame:
        raise UsageError("`start_seconds` and `start_frame` exclude each other; give one")
    if stop_seconds is not None and frames is not None:
        raise UsageError("`stop_seconds` and `frames` exclude each other; give one")
    parts = (start_frame, frames, start_seconds, stop_seconds, fps)
    if not decoder.complete and not any(parts) and speed == 1:
        meta = decoder.known
        rate = meta.average_rate.limit_denominator(_MAX_DENOMINATOR)
        return ComingFrames(meta.begin_seconds, meta.end_seconds, meta.time_base, rate)
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
    """Return a time as an exact fraction, rounded to whole ticks if it is within tolerance."""
    if not isfinite(seconds):
        raise UsageError(f"a time in seconds must be finite, not {seconds}")
    return decoder.metadata.ticks(seconds) * decoder.metadata.time_base


def _rate(value: Number, what: str) -> Fraction:
    """Return a rate as a fraction that containers can store; UsageError if out of range."""
    if not (isfinite(value) and 0 < value <= _MAX_RATE):
        raise UsageError(f"the {what} must be over 0 and at most {_MAX_RATE}, not {value}")
    rate = Fraction(value).limit_denominator(_MAX_DENOMINATOR)
    if not rate:
        raise UsageError(f"the {what} must be at least 1/{_MAX_DENOMINATOR}, not {value}")
    return rate
