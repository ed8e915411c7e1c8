"""Codec 5, ranges: the range of each row, and samples that are all alike in it.

See spec section "Codec 5". Sorted into strips, the y of Gaussians is just that.
"""

from __future__ import annotations

import numpy as np

from gsvrcodec.errors import CorruptError
from gsvrcodec.native import _entropy
from gsvrcodec.planes.samples import PlaneShape, Samples


def encode(samples: Samples, shape: PlaneShape) -> bytes:
    """The ranges of all rows, and where in them the samples are."""
    return _entropy.encode_ranges(samples)


def decode(data: bytes, shape: PlaneShape) -> Samples:
    """The samples of a stream that ends with `data`."""
    out = np.empty((shape.height, shape.width), np.uint16)
    try:
        _entropy.decode_ranges(data, shape.bits, out)
    except _entropy.Corrupt as error:
        raise CorruptError(f"damaged ranges plane: {error}") from None
    return out
