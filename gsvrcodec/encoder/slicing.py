"""Cutting a video into chains of GOPs by its motion (paper, "Dynamic-aware Time Slicing")."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Literal

import numpy as np

from gsvrcodec.encoder.analysis import FrameStats
from gsvrcodec.encoder.tuned import ANALYSIS

#: Frames of GOPs of which each but the first may be predicted from the one before.
Chain = list[range]


def slice_gops(
    stats: Sequence[FrameStats],
    gop: int | Literal["adaptive"],
    *,
    minimum: int,
    maximum: int,
    longest_chain: int = 0,
    threshold: float = ANALYSIS.threshold,
    fast_share: float = 0.0,
) -> list[Chain]:
    """Frames of each GOP, by chain; no chain spans a cut.

    A fixed `gop` ends after so many frames. For an adaptive one each frame adds its motion over
    `threshold` and 1 / `maximum`; a chain is cut into as few GOPs as keep that sum within 1, all
    of about the same sum, and none of fewer than `minimum` frames unless the chain is.

    Args:
        stats: statistics of every frame.
        gop: frames of each GOP, or by motion.
        minimum: frames of the shortest adaptive GOP.
        maximum: frames of the longest adaptive GOP.
        longest_chain: frames of the longest chain; 0 = every GOP is a chain of its own.
        threshold: motion at which a GOP ends, px of the analysed frame.
        fast_share: what the fastest motion of a frame adds to its mean motion, where all the rest
            stands still: short GOPs are cheap there.
    """
    cuts = [number for number, frame in enumerate(stats) if frame.cut or not number]
    chains: list[Chain] = []
    for begin, end in pairwise([*cuts, len(stats)]):
        parts = max(1, -(-(end - begin) // longest_chain)) if longest_chain else 1
        bounds = np.linspace(begin, end, parts + 1).round().astype(int).tolist()
        for start, stop in pairwise(bounds):
            motion = [_pace(frame, fast_share) for frame in stats[start:stop]]
            if gop == "adaptive":
                lengths = _adaptive_lengths(motion, minimum, maximum, threshold)
            else:
                lengths = [min(gop, len(motion) - at) for at in range(0, len(motion), gop)]
            ends = np.cumsum([start, *lengths]).tolist()
            found = [range(first, after) for first, after in pairwise(ends)]
            chains += [found] if longest_chain else [[one] for one in found]
    return chains


def _pace(frame: FrameStats, fast_share: float) -> float:
    return frame.motion + fast_share * (1 - frame.moving) * frame.fast


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
