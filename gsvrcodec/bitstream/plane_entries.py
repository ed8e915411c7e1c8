"""Entries of a plane table as they are coded; no plane is decoded (spec section "Plane table")."""

from __future__ import annotations

import struct
from typing import NamedTuple

from gsvrcodec.bitstream.gop_head import GopHead
from gsvrcodec.bitstream.plate import find_plate
from gsvrcodec.bitstream.varint import put_varint, take_varint
from gsvrcodec.errors import CorruptError, spec_section

#: Numbers of the codecs whose planes are image files: PNG and JPEG XL.
IMAGE_CODECS = frozenset({2, 3})

#: Codec and bits, and the number of the step; two varints follow.
ENTRY_START = struct.Struct("<BH")


class CodedEntry(NamedTuple):
    """What an entry of a plane table says."""

    codec: int  #: 0 to 15
    bits: int  #: of a sample, 1 to 16
    step: int  #: number of the quantiser step, 16 bits
    first: int  #: value of the sample 0, steps
    size: int  #: bytes of the coded plane

    def to_bytes(self) -> bytes:
        """The bytes of the entry."""
        out = bytearray(ENTRY_START.pack(self.codec + 16 * (self.bits - 1), self.step))
        put_varint(out, 2 * self.first if self.first >= 0 else -2 * self.first - 1)
        put_varint(out, self.size)
        return bytes(out)


@spec_section("5.3")
def take_entries(payload: bytes, offset: int, count: int) -> tuple[list[CodedEntry], int]:
    """Return so many entries from byte `offset` on, and the offset after them.

    Raises:
        CorruptError: An entry is cut short, or a number is longer than it need be or too large.
    """
    entries, where = [], f"plane table of {count} planes"
    for _ in range(count):
        if offset + ENTRY_START.size > len(payload):
            raise CorruptError(f"{where} cut short")
        how, step = ENTRY_START.unpack_from(payload, offset)
        zigzag, offset = take_varint(payload, offset + ENTRY_START.size, where)
        size, offset = take_varint(payload, offset, where)
        if max(zigzag, size) >= 2**32:
            raise CorruptError(f"a number of more than 32 bits in a plane table: {zigzag}, {size}")
        first = zigzag >> 1 ^ -(zigzag & 1)
        entries.append(CodedEntry(how % 16, how // 16 + 1, step, first, size))
    return entries, offset


@spec_section("5.3")
def plane_codecs(payload: bytes, head: GopHead) -> frozenset[int]:
    """Return the codec numbers in the plane table of a GOP's payload, which has this head.

    Raises:
        CorruptError: Timing, plate or plane table is cut short.
    """
    offset, left = head.length, head.frames
    while left > 0:
        count, offset = take_varint(payload, offset)
        _, offset = take_varint(payload, offset)
        _, offset = take_varint(payload, offset)
        left -= max(count, 1)
    if head.plate:
        _, offset = find_plate(payload, offset)
    entries, _ = take_entries(payload, offset, head.planes)
    return frozenset(entry.codec for entry in entries)
