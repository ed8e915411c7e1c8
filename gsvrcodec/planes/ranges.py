"""Codec 5, ranges: the range of each row, and uniformly distributed samples in it.

See spec section "Codec 5". The y of Gaussians sorted into strips has this distribution.
"""

from __future__ import annotations

import numpy as np

from gsvrcodec.errors import CorruptError
from gsvrcodec.native import _entropy
from gsvrcodec.planes.samples import PlaneShape, Samples


def encode(samples: Samples, shape: PlaneShape) -> bytes:
    """Code a plane: the range of each row, then the samples within their ranges."""
    return _entropy.encode_ranges(samples)


def decode(data: bytes, shape: PlaneShape) -> Samples:
    """Decode a plane; CorruptError if `data` is damaged or not used up exactly."""
    out = np.empty((shape.height, shape.width), np.uint16)
    try:
        _entropy.decode_ranges(data, shape.bits, out)
    except _entropy.Corrupt as error:
        raise CorruptError(f"damaged ranges plane: {error}") from None
    return out
