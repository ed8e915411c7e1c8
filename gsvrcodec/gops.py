"""GOPs of an open file: found by frame or time, unpacked when needed, kept for a while."""

from __future__ import annotations

import os
from bisect import bisect_right
from collections import OrderedDict
from threading import Lock

import numpy as np

from gsvrcodec.container.reader import GsvrReader
from gsvrcodec.errors import CorruptError
from gsvrcodec.limits import Limits
from gsvrcodec.model.pack import GopContent, unpack_gop

#: Enough for a few readers at different places of one film.
CACHED_GOPS = 4


class GopStore:
    """The GOPs of a file, those used last in memory. Safe to use from several threads."""

    def __init__(self, path: str | os.PathLike[str], limits: Limits | None) -> None:
        """Open a file; raises what `GsvrReader` does."""
        self._limits = limits or Limits.from_environment()
        self.reader = GsvrReader(path, self._limits)
        self._first_frames = [entry.first_frame for entry in self.reader.gops]
        self._start_pts = [entry.start_pts for entry in self.reader.gops]
        self._cache: OrderedDict[int, GopContent] = OrderedDict()
        self._lock = Lock()

    def get(self, position: int) -> GopContent:
        """Return the GOP at `position` of the reader's GOPs.

        Raises:
            CorruptError: it is damaged; chunk and offset are named.
        """
        with self._lock:
            if position in self._cache:
                self._cache.move_to_end(position)
                return self._cache[position]
            content = self._unpacked(position)
            self._cache[position] = content
            if len(self._cache) > CACHED_GOPS:
                self._cache.popitem(last=False)
            return content

    def frame_at(self, ticks: int) -> int:
        """Return the last frame that starts at `ticks` or before, not before the first frame."""
        content = self.get(max(0, bisect_right(self._start_pts, ticks) - 1))
        inside = int(np.searchsorted(content.pts, ticks, side="right")) - 1
        return content.first_frame + max(0, inside)

    def run_end(self, frame: int) -> int:
        """Return where the run of frames that `frame` belongs to ends: one GOP, or one gap."""
        after = bisect_right(self._first_frames, frame)
        if after and frame < self.reader.gops[after - 1].end_frame:
            return self.reader.gops[after - 1].end_frame
        return self._first_frames[after] if after < len(self._first_frames) else self.reader.frames

    def close(self) -> None:
        """Forget everything and close the file."""
        with self._lock:
            self._cache.clear()
            self.reader.close()

    def _unpacked(self, position: int) -> GopContent:
        """Read and unpack a GOP."""
        payload = self.reader.read_gop(position)
        try:
            return unpack_gop(payload, self.reader.header, self._limits)
        except CorruptError as error:
            chunk = self.reader.gops[position].chunk
            raise error.located(chunk.name, chunk.offset) from error
