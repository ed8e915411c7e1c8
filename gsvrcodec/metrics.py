"""Picture quality in numbers."""

from __future__ import annotations

from math import log10

import numpy as np
from numpy.typing import NDArray

#: PSNR of equal pictures, where the formula has no value, dB.
MAX_PSNR = 100.0


def squared_error(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> float:
    """Return the mean squared error of two 8-bit arrays of one shape.

    Raises:
        ValueError: the shapes differ.
    """
    if a.shape != b.shape:
        raise ValueError(f"pictures of shape {a.shape} and {b.shape} cannot be compared")
    difference = np.subtract(a, b, dtype=np.float64).ravel()
    return float(difference @ difference) / max(1, difference.size)


def psnr_of(mean_squared_error: float) -> float:
    """Return the PSNR of 8-bit samples for their mean squared error, dB; `MAX_PSNR` at most."""
    if mean_squared_error <= 0:
        return MAX_PSNR
    return min(MAX_PSNR, 10 * log10(255**2 / mean_squared_error))


def psnr(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> float:
    """Return the PSNR over all samples of two 8-bit arrays of one shape, dB."""
    return psnr_of(squared_error(a, b))
