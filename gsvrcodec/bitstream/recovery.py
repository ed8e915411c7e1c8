"""Recovery: find the chunks of a file without a valid index (spec section "Recovery")."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from gsvrcodec.bitstream.chunk import (
    CRITICAL_TYPES,
    END_TYPE,
    GOP_TYPE,
    HEAD_BYTES,
    HEAD_TYPE,
    OVERHEAD_BYTES,
    ChunkEntry,
    is_critical,
    parse_chunk_head,
)
from gsvrcodec.bitstream.gop_head import GOP_HEAD_BYTES, GopEntry, unpack_summary
from gsvrcodec.bitstream.source import Source
from gsvrcodec.errors import CorruptError, UnsupportedError
from gsvrcodec.limits import Limits

_WINDOW_BYTES = 1 << 20
_MAX_WARNINGS = 20
_SOUGHT = re.compile(re.escape(GOP_TYPE))


@dataclass(slots=True)
class Walk:
    """Result of a walk over the chunk heads."""

    chunks: list[ChunkEntry] = field(default_factory=list)  #: whole chunks, in file order
    gops: list[GopEntry] = field(default_factory=list)  #: GOPs in order of frames and time
    warnings: list[str] = field(default_factory=list)  #: damage, and GOPs left out

    @property
    def has_enough(self) -> bool:
        """Whether further warnings are left out."""
        return len(self.warnings) > _MAX_WARNINGS

    def warn(self, text: str) -> None:
        """Add a warning; after `_MAX_WARNINGS` only one more, "more of the same"."""
        if len(self.warnings) < _MAX_WARNINGS:
            self.warnings.append(text)
        elif len(self.warnings) == _MAX_WARNINGS:
            self.warnings.append("more of the same")


def walk(source: Source, begin: int, limits: Limits) -> Walk:
    """Walk from chunk head to chunk head; after damage go on at the next GOP.

    Of payloads only the heads of GOPs are read.

    Args:
        source: The file.
        begin: Byte offset of the first chunk after the header.
        limits: Limits on the content.

    Raises:
        CorruptError: A second header chunk.
        UnsupportedError: A critical chunk of unknown type.
        LimitError: There are more chunks, or byte sequences that look like one, than allowed.
    """
    found = Walk()
    offset = begin
    tries = 0
    while offset < source.size:
        tries += 1
        limits.check("chunks", tries, "the number of chunks")
        try:
            chunk, start = _chunk_at(source, offset)
        except CorruptError as error:
            found.warn(str(error))
            resumed, tries = _next_sound(source, offset + 1, limits, tries)
            if resumed is not None:
                found.warn(f"skipped {resumed - offset} damaged bytes at byte {offset}")
            offset = source.size if resumed is None else resumed
            continue
        _check_type(chunk)
        found.chunks.append(chunk)
        if chunk.type == GOP_TYPE:
            _add_gop(chunk, start, found)
        offset = chunk.end
        if chunk.type == END_TYPE:
            if offset != source.size:
                found.warn(f"{source.size - offset} bytes after the end of the file")
            break
    else:
        found.warn("the file has no end: its writing was not finished, or it is cut")
    return found


def _chunk_at(source: Source, offset: int) -> tuple[ChunkEntry, bytes]:
    """A chunk whose head is valid, and the start of its payload: enough for a GOP head."""
    if source.size - offset < OVERHEAD_BYTES:
        raise CorruptError("cut short in a chunk head", offset=offset)
    data = source.read(offset, min(HEAD_BYTES + GOP_HEAD_BYTES, source.size - offset))
    chunk = parse_chunk_head(data, offset)
    if chunk.end > source.size:
        raise CorruptError(
            f"{chunk.size} bytes, past the end of the file", chunk=chunk.name, offset=offset
        )
    return chunk, data[HEAD_BYTES:]


def _check_type(chunk: ChunkEntry) -> None:
    if chunk.type == HEAD_TYPE:
        raise CorruptError("second header", chunk=chunk.name, offset=chunk.offset)
    if is_critical(chunk.type) and chunk.type not in CRITICAL_TYPES:
        raise UnsupportedError(
            f"chunk {chunk.name} at byte {chunk.offset} is needed to decode this file, "
            "and this decoder does not know it"
        )


def _add_gop(chunk: ChunkEntry, start: bytes, found: Walk) -> None:
    """Add the GOP in `chunk` if its head is valid and it comes after the last GOP added."""
    previous = found.gops[-1] if found.gops else None
    if previous and found.has_enough and int.from_bytes(start[:8], "little") < previous.end_frame:
        return  # as below, without the words for a warning that nobody reads
    try:
        if chunk.size < GOP_HEAD_BYTES:
            raise CorruptError(f"GOP of {chunk.size} bytes")
        gop = unpack_summary(start, chunk)
        if previous and gop.first_frame < previous.end_frame:
            raise CorruptError(f"first frame is {gop.first_frame}, after {previous.end_frame - 1}")
        if previous and gop.start_pts <= previous.last_pts:
            raise CorruptError(f"timestamp {gop.start_pts} does not come after {previous.last_pts}")
    except CorruptError as error:
        if not found.has_enough:
            found.warn(f"GOP left out: {error.located(chunk.name, chunk.offset)}")
        return
    expected = previous.end_frame if previous else 0
    if gop.first_frame > expected:
        found.warn(f"frames {expected} to {gop.first_frame - 1} are lost")
    found.gops.append(gop)


def _next_sound(source: Source, start: int, limits: Limits, tries: int) -> tuple[int | None, int]:
    """Offset of the next valid head of a GOP, None = none; and the count of tries.

    A payload may hold bytes that look like a chunk type; the CRC of the chunk head decides.
    """
    position = start
    while position < source.size:
        size = min(_WINDOW_BYTES, source.size - position)
        window = source.read(position, size)
        for match in _SOUGHT.finditer(window):
            tries += 1
            limits.check("chunks", tries, "the number of pieces that look like a chunk")
            try:
                _chunk_at(source, position + match.start())
            except CorruptError:
                continue
            return position + match.start(), tries
        # The windows overlap by three bytes, for a type that lies across the border.
        position += size if size <= len(GOP_TYPE) else size - len(GOP_TYPE) + 1
    return None, tries
