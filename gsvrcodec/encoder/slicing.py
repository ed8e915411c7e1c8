"""Cutting a video into GOPs by its motion (paper, "Dynamic-aware Time Slicing")."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Literal

import numpy as np

from gsvrcodec.encoder.analysis import FrameStats
from gsvrcodec.encoder.tuned import ANALYSIS


def slice_gops(
    stats: Iterable[FrameStats],
    gop: int | Literal["adaptive"],
    *,
    minimum: int,
    maximum: int,
    threshold: float = ANALYSIS.threshold,
) -> list[range]:
    """Frames of each GOP; none spans a cut.

    A fixed `gop` ends after so many frames. For an adaptive one each frame adds its motion over
    `threshold` and 1 / `maximum`; a shot is cut into as few GOPs as keep that sum within 1, all
    of about the same sum, and none of fewer than `minimum` frames unless the shot is.
    """
    shots: list[list[float]] = []
    for frame in stats:
        if frame.cut or not shots:
            shots.append([])
        shots[-1].append(frame.motion)
    out: list[range] = []
    for shot in shots:
        if gop == "adaptive":
            lengths = _adaptive_lengths(shot, minimum, maximum, threshold)
        else:
            lengths = [min(gop, len(shot) - at) for at in range(0, len(shot), gop)]
        for length in lengths:
            start = out[-1].stop if out else 0
            out.append(range(start, start + length))
    return out


def _adaptive_lengths(
    motion: list[float], minimum: int, maximum: int, threshold: float
) -> list[int]:
    frames = len(motion)
    total = np.cumsum(motion) / threshold + np.arange(1, frames + 1) / maximum
    parts = max(1, min(math.ceil(total[-1] - 1e-9), frames // minimum))
    lengths: list[int] = []
    for left in range(parts, 1, -1):
        start = sum(lengths)
        done = total[start - 1] if start else 0.0
        goal = done + (total[-1] - done) / left
        length = int(np.searchsorted(total, goal)) + 1 - start
        # The GOPs after this one need their minimum, and can take no more than their maximum.
        most = min(frames - start - (left - 1) * minimum, maximum)
        least = max(frames - start - (left - 1) * maximum, minimum)
        lengths.append(min(max(length, least), most))
    # No number of GOPs may keep both bounds; then the maximum is kept.
    rest = frames - sum(lengths)
    while rest > maximum:
        lengths.append(maximum)
        rest -= maximum
    return [*lengths, rest]
