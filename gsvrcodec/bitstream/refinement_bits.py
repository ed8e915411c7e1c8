"""Bits that refine the values of Gaussians, behind the planes (spec section "Refinement")."""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.errors import CorruptError
from gsvrcodec.model.refinement import MOST_BITS, REFINED, Levels, Refinement, Refinements

_TABLE = struct.Struct("<" + "bB" * len(REFINED))
TABLE_BYTES = _TABLE.size


def pack_table(refinements: Refinements) -> bytes:
    """The table of refinements; attributes that it lacks are not refined."""
    own = [refinements.get(name, Refinement()) for name in REFINED]
    return _TABLE.pack(*(value for each in own for value in (each.least, each.most)))


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


def pack_numbers(numbers: Levels, bits: Levels) -> NDArray[np.uint8]:
    """Numbers of so many bits each as single bits, the highest of each number first."""
    shift = np.arange(MOST_BITS - 1, -1, -1)
    single = (numbers[:, None] >> shift & 1).astype(np.uint8)
    return single[shift < bits[:, None]]


def unpack_numbers(single: NDArray[np.uint8], bits: Levels) -> Levels:
    """The inverse of `pack_numbers`."""
    shift = np.arange(MOST_BITS - 1, -1, -1)
    table = np.zeros((len(bits), MOST_BITS), np.int64)
    table[shift < bits[:, None]] = single
    numbers: Levels = (table << shift).sum(axis=1)
    return numbers


def unpack_bits(data: bytes, count: int) -> NDArray[np.uint8]:
    """The bits of whole bytes, of which the last is filled up with zeros.

    Raises:
        CorruptError: Another number of bytes, or ones behind the last bit.
    """
    if len(data) != -(-count // 8):
        raise CorruptError(f"refinement of {len(data)} bytes for {count} bits")
    bits = np.unpackbits(np.frombuffer(data, np.uint8))
    if bits[count:].any():
        raise CorruptError("ones behind the last bit of the refinement")
    return bits[:count]
