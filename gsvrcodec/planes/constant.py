"""Codec 0, constant: all samples of the plane are equal (spec section "Codec 0")."""

from __future__ import annotations

import struct

import numpy as np

from gsvrcodec.errors import CorruptError
from gsvrcodec.planes.samples import PlaneShape, Samples

_VALUE = struct.Struct("<H")


def encode(samples: Samples, shape: PlaneShape) -> bytes | None:
    """Code the plane as its value, two bytes; None = the samples differ."""
    first = int(samples.flat[0])
    return _VALUE.pack(first) if (samples == first).all() else None


def decode(data: bytes, shape: PlaneShape) -> Samples:
    """Decode a plane; CorruptError if `data` is not two bytes with a value of `shape.bits` bits."""
    if len(data) != _VALUE.size:
        raise CorruptError(f"constant plane of {len(data)} bytes, expected {_VALUE.size}")
    (value,) = _VALUE.unpack(data)
    if value >= 1 << shape.bits:
        raise CorruptError(f"sample {value} in a plane of {shape.bits} bits")
    return np.full((shape.height, shape.width), value, np.uint16)
