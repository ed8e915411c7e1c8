"""Varints: numbers in groups of seven bits (spec section "Conventions")."""

from __future__ import annotations

from gsvrcodec.errors import CorruptError

#: 63 bits in groups of seven.
_MAX_VARINT_BYTES = 9


def put_varint(out: bytearray, number: int) -> None:
    """Append a varint: seven bits a byte, lowest first, the high bit set on all but the last."""
    while number > 0x7F:
        out.append(0x80 | number & 0x7F)
        number >>= 7
    out.append(number)


def take_varint(data: bytes, offset: int, where: str = "timing run") -> tuple[int, int]:
    """Return the varint at byte `offset`, and the offset after it; `where` it stands, for errors.

    Raises:
        CorruptError: The varint is cut short, or longer than it need be.
    """
    number = 0
    for position, byte in enumerate(data[offset : offset + _MAX_VARINT_BYTES]):
        number |= (byte & 0x7F) << 7 * position
        if byte < 0x80:
            if position and not byte:
                break
            return number, offset + position + 1
    raise CorruptError(f"{where} cut short or with an overlong number")
