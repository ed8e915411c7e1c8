"""Cache of decoded GOPs: found by frame or time, unpacked on demand, the last ones kept."""

from __future__ import annotations

from bisect import bisect_right
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import CancelledError, Executor, Future, ThreadPoolExecutor
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from threading import RLock
from typing import ParamSpec, TypeVar

import numpy as np

from gsvrcodec.bitstream.gop_chain import GopUnpacker, WholeGop
from gsvrcodec.bitstream.header import Header
from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.limits import Limits
from gsvrcodec.model.gop import GAUSSIAN_PARAMETERS, TRIPLANE_CHANNELS, Gop
from gsvrcodec.model.time import Ticks
from gsvrcodec.render import Prepared

P = ParamSpec("P")
T = TypeVar("T")

#: Bytes of GOPs kept in memory: of 640x320 pixels, about a hundred GOPs of 3500 Gaussians.
CACHED_BYTES = 64 * 2**20
#: What a GOP takes besides its parameters.
_OBJECTS_BYTES = 2**14
#: Bytes of a pixel of a plate, as it is stored and as it is drawn over; and GOPs that share one.
_PLATE_BYTES, _SHARED_BY = 3 + 16, 4
#: GOPs kept however large they are: enough for a few threads that read at different positions.
LEAST_CACHED_GOPS = 4


@dataclass(frozen=True, eq=False)
class ReadyGop:
    """An unpacked GOP, ready to be rendered."""

    position: int  #: its position in the file
    whole: WholeGop  #: all its Gaussians, those carried over included
    prepare: Callable[[Gop], Prepared]  #: takes them where they are rendered

    @cached_property
    def prepared(self) -> Prepared:
        """Its Gaussians where they are rendered; taken there when they are first asked for."""
        return self.prepare(self.whole.gop)

    @property
    def first_frame(self) -> int:
        """Number of its first frame in the file."""
        return self.whole.first_frame

    @property
    def pts(self) -> Ticks:
        """Presentation timestamps, shape (F,), ticks."""
        return self.whole.pts

    @property
    def durations(self) -> Ticks:
        """Durations, shape (F,), ticks, 0 = not known."""
        return self.whole.durations


class _AtOnce(Executor):
    """Runs each call in the calling thread."""

    def submit(self, call: Callable[P, T], /, *arguments: P.args, **named: P.kwargs) -> Future[T]:
        """Run a call; the future has the result or the error."""
        future: Future[T] = Future()
        try:
            future.set_result(call(*arguments, **named))
        except Exception as error:
            future.set_exception(error)
        return future


class GopCache:
    """Unpacked GOPs of a file; those used last stay in memory, `CACHED_BYTES`. Thread-safe.

    A thread of the cache unpacks GOPs, so that the next GOP can be unpacked while frames of the
    current GOP are rendered; without it they are unpacked by the thread that asks for them. GOPs
    that others are predicted from are kept like those that were asked for.
    """

    def __init__(
        self,
        reader: GsvrReader,
        limits: Limits,
        prepare: Callable[[Gop], Prepared],
        *,
        ahead: bool = True,
    ) -> None:
        """Take a file, which `close` closes; call `prepare` once a GOP.

        With `ahead`, a thread of the cache unpacks GOPs.
        """
        self.reader = reader
        self._prepare = prepare
        self._cache: OrderedDict[int, Future[ReadyGop]] = OrderedDict()
        self._most = _cached_gops(self.reader.header)
        self._unpacker = GopUnpacker(reader, limits)
        self._ahead = ahead
        self._worker = ThreadPoolExecutor(1, "gsvr-unpack") if ahead else _AtOnce()
        self._lock = RLock()  # without a worker, GOPs are unpacked by the thread that holds it
        self._closed = False

    def get(self, position: int) -> ReadyGop:
        """Return GOP `position` of the reader, with the Gaussians that it takes over.

        Raises:
            CorruptError: The GOP, or one that it is predicted from, is damaged or lost; chunk and
                offset are named.
            ValueError: The file is closed.
        """
        try:
            return self._future(position).result()
        except CancelledError:
            self.check_open()
            raise

    def prefetch(self, position: int) -> None:
        """Start to unpack GOP `position` and then the next, if there is one; return at once."""
        if not self._ahead:
            return
        for number in (position, position + 1):
            if number < len(self.reader.gops):
                self._future(number)

    def position_at(self, ticks: int | Fraction) -> int:
        """Return the position of the GOP shown at a time; 0 before the first GOP."""
        return max(0, bisect_right(self.reader.gops, ticks, key=lambda gop: gop.start_pts) - 1)

    def is_between(self, ticks: int | Fraction) -> bool:
        """Whether a time lies between the last frame of one GOP and the first of the next."""
        position = self.position_at(ticks)
        gops = self.reader.gops[position : position + 2]
        joined = len(gops) == 2 and gops[0].end_frame == gops[1].first_frame
        return joined and ticks > gops[0].last_pts

    def frame_at(self, ticks: int) -> int:
        """Return the number of the frame shown at `ticks`, not before the first frame."""
        gop = self.get(self.position_at(ticks))
        inside = int(np.searchsorted(gop.pts, ticks, side="right")) - 1
        return gop.first_frame + max(0, inside)

    def run_end(self, frame: int) -> int:
        """Return the end of the run of frames that holds `frame`: of a GOP, or of a gap."""
        gops = self.reader.gops
        after = bisect_right(gops, frame, key=lambda gop: gop.first_frame)
        if after and frame < gops[after - 1].end_frame:
            return gops[after - 1].end_frame
        return gops[after].first_frame if after < len(gops) else self.reader.frames

    def check_open(self) -> None:
        """Raise `ValueError` after `close`."""
        if self._closed:
            raise ValueError("the decoder is closed")

    def close(self) -> None:
        """Drop all GOPs and close the file."""
        with self._lock:
            self._closed = True
        self._worker.shutdown(cancel_futures=True)
        with self._lock:
            self._cache.clear()
            self.reader.close()

    def _future(self, position: int) -> Future[ReadyGop]:
        """Return the future of GOP `position` and mark the GOP as used last."""
        with self._lock:
            self.check_open()
            if position not in self._cache:
                self._add(position, self._worker.submit(self._ready, position))
            self._cache.move_to_end(position)
            return self._cache[position]

    def _add(self, position: int, future: Future[ReadyGop]) -> None:
        """Keep a GOP, in place of the one that was not used for the longest time."""
        self._cache[position] = future
        if len(self._cache) > self._most:
            self._cache.popitem(last=False)

    def _ready(self, position: int) -> ReadyGop:
        """Unpack and prepare a GOP, and keep the GOPs on the way; in one thread at a time."""
        for link, whole in self._unpacker.up_to(position, self._known):
            ready = ReadyGop(link, whole, self._prepare)
            if link != position:
                self._keep(ready, position)
        _ = ready.prepared
        return ready

    def _known(self, position: int) -> WholeGop | None:
        """Return a GOP if it is in memory, and mark it as used last."""
        with self._lock:
            future = self._cache.get(position)
            if future is None or not future.done() or future.cancelled() or future.exception():
                return None
            self._cache.move_to_end(position)
            return future.result().whole

    def _keep(self, ready: ReadyGop, wanted: int) -> None:
        """Keep a GOP that another is predicted from, which is `wanted` and stays the last used."""
        with self._lock:
            if ready.position not in self._cache:
                future: Future[ReadyGop] = Future()
                future.set_result(ready)
                self._add(ready.position, future)
            if wanted in self._cache:
                self._cache.move_to_end(wanted)


def _cached_gops(header: Header) -> int:
    """Return how many GOPs of a file may be kept in memory, all as large as the header allows."""
    x, y, time = header.max_grid
    grids = TRIPLANE_CHANNELS * (x * y + x * time + y * time)
    parameters = GAUSSIAN_PARAMETERS * header.max_gaussians + grids
    # One copy to render, and its original.
    each = _OBJECTS_BYTES + 2 * 4 * parameters
    if header.plates:
        each += _PLATE_BYTES * header.width * header.height // _SHARED_BY
    return max(LEAST_CACHED_GOPS, CACHED_BYTES // each)
