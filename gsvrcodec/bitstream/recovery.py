"""The walk from chunk to chunk, without an index or its end (spec section "The walk")."""

from __future__ import annotations

import re
import zlib

from gsvrcodec.bitstream.chunk import (
    CRITICAL_TYPES,
    END_TYPE,
    GOP_TYPE,
    HEAD_BYTES,
    HEAD_TYPE,
    OVERHEAD_BYTES,
    TAIL_BYTES,
    ChunkEntry,
    is_critical,
    parse_chunk_head,
)
from gsvrcodec.bitstream.gop_head import GOP_HEAD_BYTES, GopEntry, unpack_summary
from gsvrcodec.bitstream.source import Source
from gsvrcodec.errors import CorruptError, UnsupportedError, spec_section
from gsvrcodec.limits import Limits

_WINDOW_BYTES = 1 << 20
_MAX_WARNINGS = 20
_SOUGHT = re.compile(re.escape(GOP_TYPE))


class _CutError(CorruptError):
    """The file ends inside of a chunk."""


class Walk:
    """A walk from chunk head to chunk head; after damage it goes on at the next GOP.

    Of payloads only those of GOPs are read: their checksums tell whether their heads can be
    believed.

    Args:
        source: The file.
        begin: Byte offset of the first chunk after the header.
        limits: Limits on the content.
        stream: Whether the file may end at any byte: what is cut there has not come yet.
    """

    def __init__(self, source: Source, begin: int, limits: Limits, *, stream: bool) -> None:
        self.chunks: list[ChunkEntry] = []  #: chunks in file order; a GOP may be damaged
        self.gops: list[GopEntry] = []  #: whole GOPs in order of frames and time
        self.warnings: list[str] = []  #: damage, and GOPs left out
        self.ended = False  #: whether the end chunk was found
        self.over = False  #: whether nothing comes any more
        self._source = source
        self._offset = begin
        self._limits = limits
        self._stream = stream
        self._tries = 0

    def to_the_end(self) -> Walk:
        """Take all chunks; raises as `step`."""
        while self.step():
            pass
        return self

    def step(self) -> bool:
        """Take the next chunk; return False if there is none.

        Raises:
            CorruptError: A second header chunk.
            UnsupportedError: A critical chunk of unknown type.
            LimitError: There are more chunks, or byte sequences that look like one, than allowed.
        """
        if self.over or not self._source.reaches(self._offset + 1):
            self.over = True
            return False
        self._count("the number of chunks")
        try:
            chunk = self._chunk_at(self._offset)
        except CorruptError as error:
            found = self._next_sound(self._offset + 1)
            self.over = found is None
            if not (self.over and self._stream and isinstance(error, _CutError)):
                self._warn(str(error))
            if found is not None:
                self._warn(f"skipped {found - self._offset} damaged bytes at byte {self._offset}")
                self._offset = found
            return True
        _check_type(chunk)
        self.chunks.append(chunk)
        if chunk.type == GOP_TYPE:
            self._add_gop(chunk)
        self._offset = chunk.end
        if chunk.type == END_TYPE:
            self.ended = self.over = True
            # What follows in a pipe may be another file, and is not waited for.
            if not self._source.arriving and self._source.reaches(chunk.end + 1):
                self._warn(f"{self._source.size - chunk.end} bytes after the end of the file")
        return True

    def _chunk_at(self, offset: int) -> ChunkEntry:
        """The chunk at an offset; its head is valid, and the file holds all of it."""
        if not self._source.reaches(offset + OVERHEAD_BYTES):
            raise _CutError("cut short in a chunk head", offset=offset)
        chunk = parse_chunk_head(self._source.read(offset, HEAD_BYTES), offset)
        if not self._source.reaches(chunk.end):
            raise _CutError(
                f"{chunk.size} bytes, past the end of the file", chunk=chunk.name, offset=offset
            )
        return chunk

    def _add_gop(self, chunk: ChunkEntry) -> None:
        """Add the GOP in `chunk` if it is whole and comes after the last GOP added."""
        previous = self.gops[-1] if self.gops else None
        if previous and len(self.warnings) > _MAX_WARNINGS:
            first = self._source.read_some(chunk.payload_offset, 8)
            if int.from_bytes(first, "little") < previous.end_frame:
                return  # as below, without the words for a warning that nobody reads
        try:
            gop = self._whole_gop(chunk)
            if previous and gop.first_frame < previous.end_frame:
                what = f"first frame is {gop.first_frame}, after {previous.end_frame - 1}"
                raise CorruptError(what, section="5.1")
            if previous and gop.start_pts <= previous.last_pts:
                what = f"timestamp {gop.start_pts} does not come after {previous.last_pts}"
                raise CorruptError(what, section="5.1")
        except CorruptError as error:
            self._warn(f"GOP left out: {error.located(chunk.name, chunk.offset)}")
            return
        expected = previous.end_frame if previous else 0
        if gop.first_frame > expected:
            self._warn(f"frames {expected} to {gop.first_frame - 1} are lost")
        self.gops.append(gop)

    @spec_section("3")
    def _whole_gop(self, chunk: ChunkEntry) -> GopEntry:
        """The GOP in `chunk`, after its checksum was found right."""
        if chunk.size < GOP_HEAD_BYTES:
            raise CorruptError(f"GOP of {chunk.size} bytes", section="5.1")
        crc = 0
        payload_end = chunk.end - TAIL_BYTES
        for offset in range(chunk.payload_offset, payload_end, _WINDOW_BYTES):
            part = self._source.read(offset, min(_WINDOW_BYTES, payload_end - offset))
            crc = zlib.crc32(part, crc)
        if crc != int.from_bytes(self._source.read(payload_end, TAIL_BYTES), "little"):
            raise CorruptError("damaged payload (CRC mismatch)")
        return unpack_summary(self._source.read(chunk.payload_offset, GOP_HEAD_BYTES), chunk)

    def _next_sound(self, position: int) -> int | None:
        """Offset of the next valid head of a GOP; None = there is none.

        A payload may hold bytes that look like a chunk type; the CRC of the chunk head decides.
        """
        while window := self._source.read_some(position, _WINDOW_BYTES):
            for match in _SOUGHT.finditer(window):
                self._count("the number of pieces that look like a chunk")
                try:
                    return self._chunk_at(position + match.start()).offset
                except CorruptError:
                    continue
            # The windows overlap by three bytes, for a type that lies across the border.
            position += max(1, len(window) - len(GOP_TYPE) + 1)
        return None

    def _count(self, what: str) -> None:
        self._tries += 1
        self._limits.check("chunks", self._tries, what)

    def _warn(self, text: str) -> None:
        """Add a warning; after `_MAX_WARNINGS` only one more, "more of the same"."""
        if len(self.warnings) < _MAX_WARNINGS:
            self.warnings.append(text)
        elif len(self.warnings) == _MAX_WARNINGS:
            self.warnings.append("more of the same")


def _check_type(chunk: ChunkEntry) -> None:
    if chunk.type == HEAD_TYPE:
        raise CorruptError("second header", chunk=chunk.name, offset=chunk.offset, section="3")
    if is_critical(chunk.type) and chunk.type not in CRITICAL_TYPES:
        raise UnsupportedError(
            f"chunk {chunk.name} at byte {chunk.offset} is needed to decode this file, "
            "and this decoder does not know it"
        )
