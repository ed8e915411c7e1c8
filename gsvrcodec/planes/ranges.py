"""Codec 5, ranges: the range of each row, and uniformly distributed samples in it.

See spec section "Codec 5". The y of Gaussians sorted into strips has this distribution.
"""

from __future__ import annotations

from gsvrcodec.native import _entropy
from gsvrcodec.planes.samples import PlaneShape, Samples


def encode(samples: Samples, shape: PlaneShape) -> bytes:
    """Code a plane: the range of each row, then the samples within their ranges."""
    return _entropy.encode_ranges(samples)
