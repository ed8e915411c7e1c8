"""Index and end chunk: the table of contents (spec section "Index and end chunks")."""

from __future__ import annotations

import struct
from collections.abc import Sequence

from gsvrcodec.bitstream.chunk import (
    END_TYPE,
    GOP_TYPE,
    OVERHEAD_BYTES,
    STRUCTURAL_TYPES,
    ChunkEntry,
    is_type,
)
from gsvrcodec.bitstream.gop_head import SUMMARY_BYTES, GopEntry, unpack_summary
from gsvrcodec.errors import CorruptError, spec_section
from gsvrcodec.limits import Limits

_COUNT = struct.Struct("<I")
_ENTRY = struct.Struct("<4sQ")
_END = struct.Struct("<QQ")

ENTRY_BYTES = _ENTRY.size + SUMMARY_BYTES
END_BYTES = _END.size
#: The end chunk lies this many bytes before the end of the file.
END_CHUNK_BYTES = OVERHEAD_BYTES + END_BYTES


def index_bytes(chunks: int) -> int:
    """Bytes of the whole index chunk for a file with `chunks` entries."""
    return OVERHEAD_BYTES + _COUNT.size + chunks * ENTRY_BYTES


def index_payload(chunks: Sequence[ChunkEntry], gops: Sequence[GopEntry]) -> bytes:
    """The payload of the index chunk.

    Args:
        chunks: All chunks between header and index, in file order.
        gops: The GOPs among them, in the same order.
    """
    summaries = {gop.offset: gop.summary_bytes() for gop in gops}
    parts = [_COUNT.pack(len(chunks))]
    for chunk in chunks:
        parts.append(_ENTRY.pack(chunk.type, chunk.size))
        parts.append(summaries.get(chunk.offset, bytes(SUMMARY_BYTES)))
    return b"".join(parts)


@spec_section("9")
def parse_index(
    payload: bytes, start: int, end: int, limits: Limits
) -> tuple[list[ChunkEntry], list[GopEntry]]:
    """Parse an index; its chunks must fill the bytes from `start` to `end` without a hole.

    Offsets are not stored: they are the running sum of the chunk sizes, so chunks cannot overlap.

    Returns:
        All chunks of the index, and the GOPs among them, both in file order.

    Raises:
        CorruptError: The table does not fill its payload or the file, or an entry is invalid.
        LimitError: There are more chunks than `limits` allow.
    """
    if len(payload) < _COUNT.size:
        raise CorruptError(f"index of {len(payload)} bytes")
    (count,) = _COUNT.unpack_from(payload)
    if len(payload) != _COUNT.size + count * ENTRY_BYTES:
        raise CorruptError(f"index of {len(payload)} bytes for {count} chunks")
    limits.check("chunks", count, "the number of chunks")
    chunks: list[ChunkEntry] = []
    gops: list[GopEntry] = []
    first_frames: set[int] = set()
    offset = start
    for position in range(_COUNT.size, len(payload), ENTRY_BYTES):
        kind, size = _ENTRY.unpack_from(payload, position)
        if not is_type(kind) or (kind in STRUCTURAL_TYPES and kind != GOP_TYPE):
            raise CorruptError(f"index lists a chunk of type {kind!r}")
        chunk = ChunkEntry(kind, offset, size)
        offset = chunk.end
        if offset > end:
            raise CorruptError(f"index lists a chunk of {size} bytes past byte {end}")
        chunks.append(chunk)
        summary = payload[position + _ENTRY.size : position + ENTRY_BYTES]
        if kind != GOP_TYPE and any(summary):
            raise CorruptError(f"index has a summary of a chunk {chunk.name}")
        if kind == GOP_TYPE:
            gops.append(unpack_summary(summary, chunk))
            gops[-1].check_follows(gops[-2] if len(gops) > 1 else None)
            gops[-1].check_reference(first_frames)
            first_frames.add(gops[-1].first_frame)
    if offset != end:
        raise CorruptError(f"index ends at byte {offset}, expected {end}")
    return chunks, gops


def end_payload(index_offset: int, file_size: int) -> bytes:
    """The payload of the end chunk.

    Args:
        index_offset: Byte offset of the index chunk.
        file_size: Bytes of the whole file, the end chunk included.
    """
    return _END.pack(index_offset, file_size)


@spec_section("9")
def parse_end(payload: bytes, file_size: int) -> int:
    """Check the payload of the end chunk, and return the offset of the index chunk.

    Raises:
        CorruptError: The payload does not describe a file of `file_size` bytes.
    """
    if len(payload) != END_BYTES:
        raise CorruptError(f"end chunk of {len(payload)} bytes", chunk=END_TYPE.decode())
    index_offset, size = _END.unpack(payload)
    if size != file_size:
        raise CorruptError(f"file of {file_size} bytes, its end chunk says {size}")
    if index_offset + OVERHEAD_BYTES + END_CHUNK_BYTES > file_size:
        raise CorruptError(f"index at byte {index_offset} of a file of {file_size} bytes")
    return int(index_offset)
