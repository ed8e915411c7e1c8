"""GOPs of an open file: found by frame or time, unpacked when needed, kept for a while."""

from __future__ import annotations

import os
from bisect import bisect_right
from collections import OrderedDict
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from dataclasses import replace
from fractions import Fraction
from threading import Lock

import numpy as np

from gsvrcodec.bitstream.background_payload import unpack_background
from gsvrcodec.bitstream.gop_payload import GopContent, unpack_gop
from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.errors import CorruptError
from gsvrcodec.limits import Limits
from gsvrcodec.model.background import Background, append_background
from gsvrcodec.model.pyramid import by_level

#: Enough for a few readers at different places of one film.
CACHED_GOPS = 4


class GopStore:
    """The GOPs of a file, those used last in memory. Safe to use from several threads.

    GOPs are unpacked by a thread of the store's own, so that the next one can be made ready while
    the frames of this one are rendered.
    """

    def __init__(self, path: str | os.PathLike[str], limits: Limits | None) -> None:
        """Open a file; raises what `GsvrReader` does."""
        self._limits = limits or Limits.from_environment()
        self.reader = GsvrReader(path, self._limits)
        self._first_frames = [entry.first_frame for entry in self.reader.gops]
        self._start_pts = [entry.start_pts for entry in self.reader.gops]
        self._cache: OrderedDict[int, Future[GopContent]] = OrderedDict()
        self._unpacker = ThreadPoolExecutor(1, "gsvr-unpack")
        self._last_background: Background | None = None
        self._lock = Lock()
        self._closed = False

    def get(self, position: int) -> GopContent:
        """Return the GOP at `position` of the reader's GOPs.

        Raises:
            CorruptError: it is damaged; chunk and offset are named.
            ValueError: the file is closed.
        """
        try:
            return self._future(position).result()
        except CancelledError:
            self.check_open()
            raise

    def prefetch(self, position: int) -> None:
        """Begin to unpack the GOP at `position`, if there is one, and return at once."""
        if position < len(self.reader.gops):
            self._future(position)

    def position_at(self, ticks: int | Fraction) -> int:
        """Return the position of the GOP that plays at a time; the first one's before it starts."""
        return max(0, bisect_right(self._start_pts, ticks) - 1)

    def is_between(self, ticks: int | Fraction) -> bool:
        """Whether a time is after the last frame of one GOP and before the first of the next."""
        position = self.position_at(ticks)
        gops = self.reader.gops[position : position + 2]
        joined = len(gops) == 2 and gops[0].end_frame == gops[1].first_frame
        return joined and ticks > gops[0].last_pts

    def frame_at(self, ticks: int) -> int:
        """Return the last frame that starts at `ticks` or before, not before the first frame."""
        content = self.get(self.position_at(ticks))
        inside = int(np.searchsorted(content.pts, ticks, side="right")) - 1
        return content.first_frame + max(0, inside)

    def run_end(self, frame: int) -> int:
        """Return where the run of frames that `frame` belongs to ends: one GOP, or one gap."""
        after = bisect_right(self._first_frames, frame)
        if after and frame < self.reader.gops[after - 1].end_frame:
            return self.reader.gops[after - 1].end_frame
        return self._first_frames[after] if after < len(self._first_frames) else self.reader.frames

    def check_open(self) -> None:
        """Raise `ValueError` after `close`."""
        if self._closed:
            raise ValueError("the decoder is closed")

    def close(self) -> None:
        """Forget everything and close the file."""
        with self._lock:
            self._closed = True
        self._unpacker.shutdown(cancel_futures=True)
        with self._lock:
            self._cache.clear()
            self.reader.close()

    def _future(self, position: int) -> Future[GopContent]:
        """The GOP, or its promise, as the one used last."""
        with self._lock:
            self.check_open()
            if position not in self._cache:
                self._cache[position] = self._unpacker.submit(self._unpacked, position)
                if len(self._cache) > CACHED_GOPS:
                    self._cache.popitem(last=False)
            self._cache.move_to_end(position)
            return self._cache[position]

    def _unpacked(self, position: int) -> GopContent:
        """Read and unpack a GOP, with what it shows of its background."""
        payload = self.reader.read_gop(position)
        try:
            content = unpack_gop(payload, self.reader.header, self._limits)
            gop = content.gop
            if content.shown is not None:
                gop = append_background(
                    gop, self._background(content.background, position), content.shown
                )
        except CorruptError as error:
            chunk = self.reader.gops[position].chunk
            raise error.located(chunk.name, chunk.offset) from error
        return replace(content, gop=by_level(gop))

    def _background(self, number: int, position: int) -> Background:
        """The background that a GOP calls `number`; only the unpacker's thread calls this."""
        if self._last_background is None or self._last_background.number != number:
            chunk = self.reader.find_background(number, position).chunk
            try:
                self._last_background = unpack_background(
                    self.reader.read_chunk(chunk), self._limits
                )
            except CorruptError as error:
                raise error.located(chunk.name, chunk.offset) from error
        return self._last_background
