"""Bits that refine the values of Gaussians, behind the planes (spec section "Refinement")."""

from __future__ import annotations

import struct

import numpy as np

from gsvrcodec.errors import CorruptError, spec_section
from gsvrcodec.model.refinement import MOST_BITS, REFINED, Bits, Numbers, Refinement, Refinements
from gsvrcodec.native import _entropy

_TABLE = struct.Struct("<" + "bB" * len(REFINED))
TABLE_BYTES = _TABLE.size


def pack_table(refinements: Refinements) -> bytes:
    """The table of refinements; attributes that it lacks are not refined."""
    own = [refinements.get(name, Refinement()) for name in REFINED]
    return _TABLE.pack(*(value for each in own for value in (each.least, each.most)))


@spec_section("5.6")
def parse_table(data: bytes) -> dict[str, Refinement]:
    """Refinements by attribute name, of those attributes that are refined.

    Raises:
        CorruptError: The table is cut short, or asks for too many bits.
    """
    if len(data) != TABLE_BYTES:
        raise CorruptError("refinement cut short")
    fields = _TABLE.unpack(data)
    found = {}
    for name, least, most in zip(REFINED, fields[::2], fields[1::2], strict=True):
        if most > MOST_BITS or (least and not most):
            raise CorruptError(f"refinement of {name} by {most} bits from level {least}")
        if most:
            found[name] = Refinement(least, most)
    return found


def pack_numbers(numbers: Numbers, bits: Bits) -> bytes:
    """Numbers of so many bits each, the highest bit first, filled up with zeros to whole bytes."""
    shift = np.arange(MOST_BITS - 1, -1, -1)
    single = (numbers[:, None] >> shift & 1).astype(np.uint8)
    return np.packbits(single[shift < bits[:, None]]).tobytes()


@spec_section("5.6")
def unpack_numbers(data: bytes, bits: Bits) -> Numbers:
    """The inverse of `pack_numbers`.

    Raises:
        CorruptError: Another number of bytes, or ones behind the last bit.
    """
    count = int(bits.sum(dtype=np.int64))
    if len(data) != -(-count // 8):
        raise CorruptError(f"refinement of {len(data)} bytes for {count} bits")
    if count % 8 and data[-1] & 0xFF >> count % 8:
        raise CorruptError("ones behind the last bit of the refinement")
    numbers = np.empty(bits.shape, np.uint8)
    _entropy.unpack_numbers(data, bits, numbers)
    return numbers
