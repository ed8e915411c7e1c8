"""Where the plate of a GOP lies in its payload (spec section "Plate")."""

from __future__ import annotations

import struct

from gsvrcodec.errors import CorruptError, spec_section

_LENGTH = struct.Struct("<I")


def plate_bytes(data: bytes | None) -> bytes:
    """Return the part of a GOP's payload that holds a coded plate; None = no plate."""
    return b"" if data is None else _LENGTH.pack(len(data)) + data


@spec_section("5.7")
def find_plate(payload: bytes, offset: int) -> tuple[bytes, int]:
    """Return the coded plate at an offset of a GOP's payload, and the offset behind it.

    Raises:
        CorruptError: The payload ends before it.
    """
    begin = offset + _LENGTH.size
    if begin > len(payload):
        raise CorruptError("the payload ends in its plate")
    end = begin + int(_LENGTH.unpack_from(payload, offset)[0])
    if end > len(payload):
        raise CorruptError(f"plate of {end - begin} bytes where {len(payload) - begin} are left")
    return payload[begin:end], end
