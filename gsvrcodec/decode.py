"""Decoding: container, planes, model, rendering, frames; any frame, in any order."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator, Sequence
from fractions import Fraction
from itertools import groupby
from math import ceil, floor, isfinite
from types import TracebackType
from typing import Self, overload

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.errors import CorruptError
from gsvrcodec.frames import Frame, FrameBatch, Metadata
from gsvrcodec.gops import GopStore
from gsvrcodec.limits import Limits
from gsvrcodec.model.pack import GopContent
from gsvrcodec.model.timing import normalised_time
from gsvrcodec.render import render_frames

_log = logging.getLogger(__name__)

#: Frames rendered together while iterating: at most this many, and this many bytes.
_BATCH_FRAMES = 16
_BATCH_BYTES = 64 * 2**20

#: Ticks that a time in seconds may fall short of the timestamp it was computed from.
_TICK_TOLERANCE = 1e-6


class Decoder:
    """The frames of a .gsvr file. Safe to use from several threads."""

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        threads: int = 0,
        limits: Limits | None = None,
        keep_going: bool = False,
    ) -> None:
        """Open a file; see `open`."""
        self._store = GopStore(path, limits)
        self._reader = self._store.reader
        self._threads = threads
        self._keep_going = keep_going
        self._closed = False
        self.lost_frames = 0  #: frames that iteration had to leave out, for `keep_going`
        if self._reader.recovered and not keep_going:
            self._store.close()
            found = sum(entry.frames for entry in self._reader.gops)
            raise CorruptError(
                f"the file is cut short or damaged: {self._reader.warnings[0]}; "
                f"{found} frames were found, which --keep-going decodes"
            )
        self.metadata = Metadata.of(self._reader)  #: the facts about the whole video

    def __enter__(self) -> Self:
        """Return the decoder itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the file."""
        self.close()

    def close(self) -> None:
        """Close the file; asking for frames then raises `ValueError`."""
        self._closed = True
        self._store.close()

    @property
    def recovered(self) -> bool:
        """Whether the file is cut short or damaged, and was opened with `keep_going`."""
        return self._reader.recovered

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is wrong with the file and does not keep it from being decoded."""
        return self._reader.warnings

    def __len__(self) -> int:
        """Return the number of frames."""
        return self._reader.frames

    @overload
    def __getitem__(self, key: int) -> Frame: ...
    @overload
    def __getitem__(self, key: slice) -> FrameBatch: ...
    def __getitem__(self, key: int | slice) -> Frame | FrameBatch:
        """Return frame `key`, from the end if negative, or the frames of a slice."""
        if isinstance(key, slice):
            return self.get_frames_at(range(*key.indices(len(self))))
        return self.get_frame_at(key)

    def __iter__(self) -> Iterator[Frame]:
        """Yield all frames in order."""
        return self.frames()

    def get_frame_at(self, index: int) -> Frame:
        """Return one frame.

        Args:
            index: its number, from 0; -1 = the last.

        Raises:
            IndexError: there is no such frame.
            CorruptError: its GOP is damaged.
            ValueError: the decoder is closed.
        """
        return self.get_frames_at([index])[0]

    def get_frames_at(self, indices: Sequence[int]) -> FrameBatch:
        """Return frames in the order of `indices`; a number may come twice. Raises as above."""
        self._check_open()
        numbers = [self._number(index) for index in indices]
        header, count = self._reader.header, len(numbers)
        data = np.empty((count, header.height, header.width, 3), np.uint8)
        pts, durations = np.empty(count, np.int64), np.empty(count, np.int64)
        start = 0
        for position, group in groupby(numbers, self._reader.gop_of_frame):
            content = self._store.get(position)
            inside = np.fromiter(group, np.int64) - content.first_frame
            part = slice(start, start + len(inside))
            pts[part], durations[part] = content.pts[inside], content.durations[inside]
            self._render(content, inside, data[part])
            start = part.stop
        base = header.time_base
        return FrameBatch(
            data=data,
            index=np.array(numbers, np.int64),
            pts=pts,
            duration=durations,
            pts_seconds=np.array([float(tick * base) for tick in pts.tolist()]),
            duration_seconds=np.array([float(tick * base) for tick in durations.tolist()]),
        )

    def get_frame_played_at(self, seconds: float) -> Frame:
        """Return the frame on screen at a time.

        Raises:
            ValueError: nothing is shown then, or the decoder is closed.
        """
        return self.get_frame_at(self._played_at(seconds))

    def get_frames_played_in_range(self, start_seconds: float, stop_seconds: float) -> FrameBatch:
        """Return the frames on screen from `start_seconds` up to, not at, `stop_seconds`.

        Raises:
            ValueError: the range is turned round or reaches out of the video.
        """
        ticks = self._ticks(stop_seconds)
        if start_seconds > stop_seconds or ticks > self._ticks(self.metadata.end_seconds):
            raise ValueError(f"{start_seconds} s to {stop_seconds} s: {self._span()}")
        first = self._played_at(start_seconds)
        if start_seconds == stop_seconds:
            return self.get_frames_at([])
        last = self._store.frame_at(ceil(ticks - _TICK_TOLERANCE) - 1)
        return self.get_frames_at(range(first, last + 1))

    def frames(self, start: int = 0, stop: int | None = None) -> Iterator[Frame]:
        """Yield frames `start` up to `stop`, None = to the end, with few of them in memory.

        With `keep_going`, frames that are damaged or lost are left out and counted.
        """
        self._check_open()
        stop = len(self) if stop is None else min(stop, len(self))
        frame_bytes = 3 * self._reader.header.width * self._reader.header.height
        batch = max(1, min(_BATCH_FRAMES, _BATCH_BYTES // frame_bytes))
        while start < stop:
            end = min(self._store.run_end(start), start + batch, stop)
            try:
                if self._store.run_end(start) < stop:
                    self._store.prefetch(self._reader.gop_of_frame(start) + 1)
                frames = self.get_frames_at(range(start, end))
            except CorruptError as error:
                if not self._keep_going:
                    raise
                end = min(self._store.run_end(start), stop)
                self.lost_frames += end - start
                _log.warning("frames %d to %d are left out: %s", start, end - 1, error)
            else:
                yield from frames
            start = end

    def _render(
        self, content: GopContent, inside: NDArray[np.int64], out: NDArray[np.uint8]
    ) -> None:
        """Render the frames numbered `inside` a GOP into `out`."""
        header = self._reader.header
        size = header.width, header.height
        taus = normalised_time(content.pts)[inside]
        render_frames(content.gop, taus, size, size, threads=self._threads, out=out)

    def _number(self, index: int) -> int:
        """Return a frame number from 0 for an index that may count from the end."""
        number = index + len(self) if index < 0 else index
        if not 0 <= number < len(self):
            raise IndexError(f"frame {index} of a video of {len(self)} frames")
        return number

    def _played_at(self, seconds: float) -> int:
        """Return the number of the frame on screen at a time."""
        self._check_open()
        ticks = floor(self._ticks(seconds) + _TICK_TOLERANCE)
        meta = self.metadata
        if not meta.begin_seconds <= ticks * meta.time_base < meta.end_seconds:
            raise ValueError(f"nothing is shown at {seconds} s: {self._span()}")
        return self._store.frame_at(ticks)

    def _ticks(self, seconds: float | Fraction) -> float:
        """Return a time in ticks and parts of one."""
        if not isfinite(seconds):
            raise ValueError(f"a time in seconds must be finite, not {seconds}")
        return float(Fraction(seconds) / self._reader.header.time_base)

    def _span(self) -> str:
        """Return when the video starts and ends, for messages."""
        begin, end = float(self.metadata.begin_seconds), float(self.metadata.end_seconds)
        return f"the video runs from {begin:.6g} s to {end:.6g} s"

    def _check_open(self) -> None:
        """Refuse to work after `close`."""
        if self._closed:
            raise ValueError("the decoder is closed")


def open(
    path: str | os.PathLike[str],
    *,
    threads: int = 0,
    limits: Limits | None = None,
    keep_going: bool = False,
) -> Decoder:
    """Open a .gsvr file for decoding.

    Args:
        path: the file.
        threads: to render with; 0 = GSVR_THREADS or all cores. Does not change the pictures.
        limits: what to accept; None = the defaults, or the environment's.
        keep_going: also open a file that was cut short, and leave out damaged GOPs when iterating.

    Raises:
        InputError: the file cannot be read.
        NotGsvrError: it is something else.
        CorruptError: it is damaged.
        UnsupportedError: it needs something this version does not have, or is over `limits`.
    """
    return Decoder(path, threads=threads, limits=limits, keep_going=keep_going)
