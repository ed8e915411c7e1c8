"""Codec 0, constant: all samples of the plane are equal (spec section "Codec 0")."""

from __future__ import annotations

import struct

from gsvrcodec.planes.samples import PlaneShape, Samples

_VALUE = struct.Struct("<H")


def encode(samples: Samples, shape: PlaneShape) -> bytes | None:
    """Code the plane as its value, two bytes; None = the samples differ."""
    first = int(samples.flat[0])
    return _VALUE.pack(first) if (samples == first).all() else None
