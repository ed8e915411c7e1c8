"""Which Gaussians are in the picture."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.model.gop import Float32Array, Gop
from gsvrcodec.model.reconstruction import CUTOFF

#: Where a Gaussian ends, in its scale.
_REACH = math.sqrt(-2 * math.log(CUTOFF))


def seen(gop: Gop, taus: Float32Array, size: tuple[int, int]) -> NDArray[np.bool_]:
    """Return which Gaussians may reach into the frame at some of the times, (N,).

    Offsets of the tri-plane are left out: they are small, and take long to look up.

    Args:
        gop: N Gaussians.
        taus: Times of the frames, normalised.
        size: Width and height of the coded frame, pixels.
    """
    reach = _REACH * np.exp(gop.log_scale.max(axis=1, keepdims=True))
    edge = 1 + reach / (np.array(size, np.float32) / 2)
    found = np.zeros(len(gop), np.bool_)
    for tau in taus:
        position = gop.position + tau * (gop.linear + tau * gop.quadratic)
        found |= (np.abs(position) < edge).all(axis=1)
    return found
