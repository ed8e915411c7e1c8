"""Signature and chunk framing (spec sections "Signature" and "Chunks")."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from mmap import mmap

from gsvrcodec.errors import CorruptError, NotGsvrError, spec_section

#: Payload of a chunk: bytes in memory, or a memory-mapped file for a large payload.
Payload = bytes | mmap

#: High bit, name, CR LF, DOS end of file, LF: each kind of text-mode transfer breaks one of them.
SIGNATURE = b"\x89GSV\r\n\x1a\n"

HEAD_TYPE = b"HEAD"
GOP_TYPE = b"GOPD"
INDEX_TYPE = b"indx"
END_TYPE = b"fend"
SETTINGS_TYPE = b"sett"
METADATA_TYPE = b"meta"
STREAMS_TYPE = b"strm"

CRITICAL_TYPES = frozenset({HEAD_TYPE, GOP_TYPE})
#: Types that only the writer itself may write; `add_auxiliary` refuses them.
STRUCTURAL_TYPES = frozenset({HEAD_TYPE, GOP_TYPE, INDEX_TYPE, END_TYPE})
#: Auxiliary types of which a file has at most one.
SINGLE_TYPES = (SETTINGS_TYPE, METADATA_TYPE)

_FIELDS = struct.Struct("<4sQ")
_CRC = struct.Struct("<I")

HEAD_BYTES = _FIELDS.size + _CRC.size  #: type, length and their CRC
TAIL_BYTES = _CRC.size  #: CRC of the payload
OVERHEAD_BYTES = HEAD_BYTES + TAIL_BYTES


@dataclass(frozen=True, slots=True)
class ChunkEntry:
    """Type, place and size of one chunk."""

    type: bytes  #: four ASCII letters
    offset: int  #: byte offset of the chunk's head
    size: int  #: bytes of the payload

    @property
    def name(self) -> str:
        """The chunk type as text, for messages."""
        return self.type.decode("ascii", "replace")

    @property
    def payload_offset(self) -> int:
        """Byte offset of the payload."""
        return self.offset + HEAD_BYTES

    @property
    def end(self) -> int:
        """Byte offset of the first byte after the chunk."""
        return self.offset + OVERHEAD_BYTES + self.size


def is_type(kind: bytes) -> bool:
    """Whether `kind` is a valid chunk type: four ASCII letters."""
    return len(kind) == 4 and kind.isalpha()


def is_critical(kind: bytes) -> bool:
    """Whether a reader that does not know this type must refuse the file."""
    return kind[:1].isupper()


def chunk_head(kind: bytes, size: int) -> bytes:
    """The chunk head, 16 bytes, for a payload of `size` bytes."""
    if not is_type(kind):
        raise ValueError(f"a chunk type is four ASCII letters, not {kind!r}")
    fields = _FIELDS.pack(kind, size)
    return fields + _CRC.pack(zlib.crc32(fields))


def chunk_parts(kind: bytes, payload: Payload) -> tuple[bytes, Payload, bytes]:
    """Head, payload and tail of a chunk; the payload is not copied."""
    return chunk_head(kind, len(payload)), payload, _CRC.pack(zlib.crc32(payload))


def chunk_bytes(kind: bytes, payload: bytes) -> bytes:
    """A whole chunk."""
    return b"".join(chunk_parts(kind, payload))


@spec_section("3")
def parse_chunk_head(head: bytes, offset: int) -> ChunkEntry:
    """Parse and check a chunk head read at `offset`; the caller checks the length against the file.

    Raises:
        CorruptError: The CRC does not match, or the type is not four ASCII letters.
    """
    kind, size = _FIELDS.unpack_from(head)
    (crc,) = _CRC.unpack_from(head, _FIELDS.size)
    if zlib.crc32(head[: _FIELDS.size]) != crc:
        raise CorruptError("damaged chunk head (CRC mismatch)", offset=offset)
    if not is_type(kind):
        raise CorruptError(f"invalid chunk type {kind!r}", offset=offset)
    return ChunkEntry(kind, offset, size)


@spec_section("3")
def check_payload(entry: ChunkEntry, data: bytes) -> bytes:
    """Check the CRC behind a payload and return the payload; `data` is payload and CRC.

    Raises:
        CorruptError: The CRC does not match.
    """
    payload = data[: entry.size]
    (crc,) = _CRC.unpack_from(data, entry.size)
    if zlib.crc32(payload) != crc:
        raise CorruptError("damaged payload (CRC mismatch)", chunk=entry.name, offset=entry.offset)
    return payload


@spec_section("2")
def check_signature(start: bytes) -> None:
    """Check the first bytes of a file.

    Raises:
        NotGsvrError: `start` is not the signature; the message names the likely cause if known.
    """
    if start[: len(SIGNATURE)] == SIGNATURE:
        return
    if not start:
        cause = "it is empty"
    elif SIGNATURE.startswith(start):
        cause = "it ends inside the signature"
    elif start[:4] == SIGNATURE[:4]:
        cause = "the signature was damaged, probably by a transfer that converts line ends"
    elif start[:4] == bytes([SIGNATURE[0] & 0x7F]) + SIGNATURE[1:4]:
        cause = "the signature lost its high bit, probably in a 7-bit transfer"
    else:
        cause = "the signature is missing"
    raise NotGsvrError(f"not a .gsvr file: {cause}")
