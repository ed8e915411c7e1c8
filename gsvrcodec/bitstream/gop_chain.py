"""Whole GOPs of a file: each through the GOPs that it is predicted from."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.bitstream.chunk import ChunkEntry
from gsvrcodec.bitstream.gop_payload import GopContent, unpack_gop
from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.errors import CorruptError
from gsvrcodec.limits import Limits
from gsvrcodec.model.gop import GAUSSIAN_PARAMETERS, Gop
from gsvrcodec.model.prediction import DROPPED
from gsvrcodec.model.time import Ticks


@dataclass(frozen=True, slots=True, eq=False)
class WholeGop:
    """A GOP with the Gaussians that it takes over from its reference."""

    gop: Gop  #: all Gaussians; those taken over come first, in the order of the reference
    first_frame: int  #: number of its first frame in the file
    pts: Ticks  #: (F,) presentation timestamps, ticks
    durations: Ticks  #: (F,) durations, ticks, 0 = not known
    reference: int | None = None  #: position of the reference in the file; None = key GOP
    kept: NDArray[np.bool_] | None = None  #: (M,) which Gaussians of the reference it takes over


class GopUnpacker:
    """Unpacks the GOPs of a file; for one thread.

    The GOPs unpacked last stay in memory, so that GOPs in a row are unpacked once each; any other
    GOP is unpacked from the nearest of them in its chain, or from the key GOP. All ways give the
    same values.

    Args:
        reader: The file.
        limits: Limits on the content.
        remembered: GOPs to keep in memory.
    """

    def __init__(self, reader: GsvrReader, limits: Limits, remembered: int = 2) -> None:
        self._reader = reader
        self._limits = limits
        self._most = remembered
        self._recent: OrderedDict[int, WholeGop] = OrderedDict()
        self._faults: dict[int, CorruptError] = {}

    def __len__(self) -> int:
        """Return the number of GOPs in memory."""
        return len(self._recent)

    def unpack(self, position: int) -> WholeGop:
        """Return GOP `position` of the reader.

        Raises:
            CorruptError: The GOP, or one of its chain, is damaged or lost; the damaged chunk and
                its offset are named.
            LimitError: The GOP, or one of its chain, is over the limits.
        """
        chain = self._reader.chain_of(position)
        start = max((n for n, link in enumerate(chain) if link in self._recent), default=-1)
        if start >= 0:
            self._recent.move_to_end(chain[start])
        for number in range(start + 1, len(chain)):
            link = chain[number]
            if link in self._faults:
                raise self._fault(link, position)
            try:
                with _located(self._reader.gops[link].chunk):
                    content = self._content(chain[: number + 1])
                    whole = self._whole(content, chain[number - 1] if number else None)
            except CorruptError as error:
                self._faults[link] = error.located(error.chunk or "", error.offset or 0)
                raise self._fault(link, position) from error
            self._recent[link] = whole
            if len(self._recent) > self._most:
                self._recent.popitem(last=False)
        return self._recent[position]

    def _content(self, chain: list[int]) -> GopContent:
        """Decode what the last GOP of a chain holds."""
        entry = self._reader.gops[chain[-1]]
        payload = self._reader.read_gop(chain[-1])
        # Not before the checksum is known to be right: damage is no reason to stop.
        sizes = sum(self._reader.gops[link].size for link in chain)
        self._limits.check_expansion(4 * GAUSSIAN_PARAMETERS * entry.gaussians, sizes)
        return unpack_gop(payload, self._reader.header, self._limits)

    def _whole(self, content: GopContent, reference: int | None) -> WholeGop:
        """Take over what stays of the reference, which is in memory."""
        whole, kept = content.new, None
        if reference is not None and content.carried is not None:
            known = self._recent[reference]
            blending = self._reader.header.blending
            whole = content.gop(known.gop, len(known.pts), blending)
            kept = content.carried.mode != DROPPED
        return WholeGop(whole, content.first_frame, content.pts, content.durations, reference, kept)

    def _fault(self, link: int, position: int) -> CorruptError:
        """Return the error of a GOP of the chain, for the GOP that was asked for."""
        error = self._faults[link]
        if link == position:
            return error.located("", 0)
        first = self._reader.gops[position].first_frame
        return CorruptError(
            f"{error.message}; the GOP at frame {first} is predicted from this one",
            chunk=error.chunk,
            offset=error.offset,
            section=error.section,
        )


@contextmanager
def _located(chunk: ChunkEntry) -> Iterator[None]:
    """Add type and offset of `chunk` to a `CorruptError` of the block that names no place."""
    try:
        yield
    except CorruptError as error:
        raise error.located(chunk.name, chunk.offset) from error
