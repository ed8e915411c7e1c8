"""Normalised time: tau runs from -1 at the first frame of a GOP to 1 at its last (spec 8.1)."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.model.gop import Float32Array

Ticks = NDArray[np.int64]


def normalised_time(pts: Ticks) -> Float32Array:
    """Tau of each frame of a GOP: -1 at the first frame, 1 at the last, 0 for a single frame.

    Args:
        pts: Shape (F,), strictly increasing, ticks.

    Returns:
        Shape (F,), float32.
    """
    if len(pts) < 2:
        return np.zeros(len(pts), np.float32)
    since = (pts - pts[0]).astype(np.float64)
    tau: Float32Array = ((2.0 * since - since[-1]) / since[-1]).astype(np.float32)
    return tau


def time_at(pts: Ticks, ticks: int | Fraction) -> np.float32:
    """Tau of any time, linear in time from -1 at the first frame of a GOP to 1 at the last.

    tau is clamped to -1 before the first frame and to 1 after the last frame: motion is not
    extrapolated.

    Args:
        pts: Shape (F,), strictly increasing, ticks.
        ticks: The time, in ticks; may be a fraction.
    """
    first, last = int(pts[0]), int(pts[-1])
    if first == last:
        return np.float32(0)
    since, span = float(min(max(ticks, first), last) - first), float(last - first)
    return np.float32((2.0 * since - span) / span)
