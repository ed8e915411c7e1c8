"""Whole GOPs of a file: each through the GOPs that it is predicted from."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.bitstream.chunk import ChunkEntry
from gsvrcodec.bitstream.gop_payload import GopContent, unpack_gop, unpack_plate
from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.errors import CorruptError
from gsvrcodec.limits import Limits
from gsvrcodec.model.gop import GAUSSIAN_PARAMETERS, Gop
from gsvrcodec.model.plate import Plate
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
    plate: Plate | None = None  #: behind its Gaussians; None = none


class GopUnpacker:
    """Unpacks the GOPs of a file; for one thread.

    A GOP is unpacked from the nearest known GOP of its chain, or from the key GOP. All ways give
    the same values.

    Args:
        reader: The file.
        limits: Limits on the content.
    """

    def __init__(self, reader: GsvrReader, limits: Limits) -> None:
        self._reader = reader
        self._limits = limits
        self._last: dict[int, WholeGop] = {}
        self._plate: tuple[int, Plate] | None = None  # the last one, and the first frame of its GOP
        self._faults: dict[int, CorruptError] = {}

    def unpack(self, position: int) -> WholeGop:
        """Return GOP `position` of the reader; GOPs in a row are unpacked once each.

        Raises:
            CorruptError: The GOP, or one of its chain, is damaged or lost; the damaged chunk and
                its offset are named.
            LimitError: The GOP, or one of its chain, is over the limits.
        """
        for link, whole in self.up_to(position, self._last.get):
            self._last = {link: whole}
        return self._last[position]

    def up_to(
        self, position: int, known: Callable[[int], WholeGop | None]
    ) -> Iterator[tuple[int, WholeGop]]:
        """Unpack the GOPs of a chain, and yield each with its position; raises as `unpack`.

        Args:
            position: The last one, position in the reader.
            known: A GOP of the chain by its position; None = it has to be unpacked. The nearest
                known one is begun from.
        """
        chain = self._reader.chain_of(position)
        for link in chain:
            if link in self._faults:
                raise self._fault(link, position)
        start, whole = len(chain), None
        while start and (whole := known(chain[start - 1])) is None:
            start -= 1
        for number, link in enumerate(chain[start:], start):
            before = chain[number - 1] if number else None
            try:
                with _located(self._reader.gops[link].chunk):
                    whole = self._whole(self._content(chain[: number + 1]), before, whole)
            except CorruptError as error:
                self._faults[link] = error.located(error.chunk or "", error.offset or 0)
                raise self._fault(link, position) from error
            yield link, whole

    def _content(self, chain: list[int]) -> GopContent:
        """Decode what the last GOP of a chain holds."""
        entry = self._reader.gops[chain[-1]]
        payload = self._reader.read_gop(chain[-1])
        # Not before the checksum is known to be right: damage is no reason to stop.
        sizes = sum(self._reader.gops[link].size for link in chain)
        self._limits.check_expansion(4 * GAUSSIAN_PARAMETERS * entry.gaussians, sizes)
        return unpack_gop(payload, self._reader.header, self._limits)

    def _whole(
        self, content: GopContent, reference: int | None, known: WholeGop | None
    ) -> WholeGop:
        """Take over what stays of the reference, whose position and content are given."""
        header = self._reader.header
        whole, kept, plate = content.new, None, None
        if content.plate is not None:
            plate = self._unpacked(content.first_frame, content.plate)
        if known is not None and content.carried is not None:
            whole = content.gop(known.gop, len(known.pts), header.blending)
            kept, plate = content.carried.mode != DROPPED, known.plate
        times = content.pts, content.durations
        return WholeGop(whole, content.first_frame, *times, reference, kept, plate)

    def _unpacked(self, first_frame: int, coded: bytes) -> Plate:
        """Decode a plate, unless it is the last one: GOPs of many chains may be in front of it."""
        if self._plate is None or self._plate[0] != first_frame:
            size = self._reader.header.width, self._reader.header.height
            self._limits.check_expansion(3 * size[0] * size[1], len(coded))
            self._plate = first_frame, unpack_plate(coded, size)
        return self._plate[1]

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
