"""Ways to break a .gsvr file, as an attacker would: with every checksum put right again."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from gsvrcodec.bitstream.chunk import (
    END_TYPE,
    HEAD_BYTES,
    HEAD_TYPE,
    INDEX_TYPE,
    OVERHEAD_BYTES,
    SIGNATURE,
    TAIL_BYTES,
    chunk_bytes,
)
from gsvrcodec.bitstream.gop_head import GOP_HEAD_BYTES, SUMMARY_BYTES
from gsvrcodec.bitstream.plane_entries import take_entries


@dataclass(frozen=True)
class Piece:
    """A chunk of a file in memory."""

    type: bytes
    payload: bytes

    def to_bytes(self) -> bytes:
        return chunk_bytes(self.type, self.payload)


def pieces(data: bytes) -> list[Piece]:
    """The chunks of a sound file."""

    def walk() -> Iterator[Piece]:
        offset = len(SIGNATURE)
        while offset < len(data):
            kind, size = struct.unpack_from("<4sQ", data, offset)
            start = offset + HEAD_BYTES
            yield Piece(kind, data[start : start + size])
            offset = start + size + TAIL_BYTES

    return list(walk())


def joined(chunks: list[Piece], *, reindex: bool = True) -> bytes:
    """Chunks as a file; `reindex` makes index and end chunk describe it."""
    if reindex:
        chunks = [piece for piece in chunks if piece.type not in (INDEX_TYPE, END_TYPE)]
        offset = len(SIGNATURE) + sum(OVERHEAD_BYTES + len(piece.payload) for piece in chunks)
        entries = b"".join(
            piece.type
            + struct.pack("<Q", len(piece.payload))
            + (piece.payload[:SUMMARY_BYTES] if piece.type == b"GOPD" else bytes(SUMMARY_BYTES))
            for piece in chunks
            if piece.type != HEAD_TYPE
        )
        count = sum(piece.type != HEAD_TYPE for piece in chunks)
        index = Piece(INDEX_TYPE, struct.pack("<I", count) + entries)
        size = offset + 2 * OVERHEAD_BYTES + len(index.payload) + 16
        chunks = [*chunks, index, Piece(END_TYPE, struct.pack("<QQ", offset, size))]
    return SIGNATURE + b"".join(piece.to_bytes() for piece in chunks)


def edited(
    data: bytes, kind: bytes, edit: Callable[[bytearray], object], *, reindex: bool = True
) -> bytes:
    """The file with the first chunk of a type changed by `edit`, checksums and index made right."""
    chunks = pieces(data)
    at = next(i for i, piece in enumerate(chunks) if piece.type == kind)
    payload = bytearray(chunks[at].payload)
    edit(payload)
    chunks[at] = Piece(kind, bytes(payload))
    return joined(chunks, reindex=reindex)


def patched(data: bytes, kind: bytes, offset: int, layout: str, *values: float | bytes) -> bytes:
    """The file with fields of a chunk's payload overwritten, checksums and index made right."""
    return edited(
        data,
        kind,
        lambda payload: struct.pack_into("<" + layout, payload, offset, *values),
        reindex=kind not in (INDEX_TYPE, END_TYPE),
    )


#: Offset of the plane table in a GOP whose timing is a single run of small numbers.
TABLE_OFFSET = GOP_HEAD_BYTES + 3
#: Planes of a key GOP with a tri-plane, where pictures are means; in a predicted GOP that has new
#: Gaussians too, the number of the plane `mode`.
MODES = 14 + 3 * 6


def with_plane(payload: bytes, plane: int, data: bytes, **fields: int) -> bytes:
    """A GOP's payload with one plane's bytes replaced, and fields of its table entry.

    Fields: those of `CodedEntry`, `size` too; without it that of `data`.
    """
    (planes,) = struct.unpack_from("<H", payload, SUMMARY_BYTES + 2)
    entries, at = take_entries(payload, TABLE_OFFSET, planes)
    parts = []
    for entry in entries:
        parts.append(payload[at : at + entry.size])
        at += entry.size
    parts[plane] = data
    entries[plane] = entries[plane]._replace(**{"size": len(data), **fields})
    table = b"".join(entry.to_bytes() for entry in entries)
    return payload[:TABLE_OFFSET] + table + b"".join([*parts, payload[at:]])
