"""Codec numbers of the planes of a GOP; nothing is decoded (spec section "Header chunk")."""

from __future__ import annotations

import struct

from gsvrcodec.bitstream.gop_head import GopHead
from gsvrcodec.bitstream.varint import take_varint
from gsvrcodec.errors import CorruptError, spec_section

#: Numbers of the codecs whose planes are image files: PNG and JPEG XL.
IMAGE_CODECS = frozenset({2, 3})

#: Attribute, component, codec, bits, offset, step and bytes of a plane.
PLANE_ENTRY = struct.Struct("<BBBBffI")


@spec_section("5.3")
def plane_codecs(payload: bytes, head: GopHead) -> frozenset[int]:
    """Return the codec numbers in the plane table of a GOP's payload, which has this head.

    Raises:
        CorruptError: Timing or plane table is cut short.
    """
    offset, left = head.length, head.frames
    while left > 0:
        count, offset = take_varint(payload, offset)
        _, offset = take_varint(payload, offset)
        _, offset = take_varint(payload, offset)
        left -= max(count, 1)
    end = offset + head.planes * PLANE_ENTRY.size
    if end > len(payload):
        raise CorruptError(f"plane table of {head.planes} planes cut short")
    return frozenset(payload[offset + 2 : end : PLANE_ENTRY.size])
