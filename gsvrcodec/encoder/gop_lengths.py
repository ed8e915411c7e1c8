"""How long adaptive GOPs are (paper, "Dynamic-aware Time Slicing")."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from statistics import fmean
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.encoder.tuned import GOP_LENGTH, PATHS

if TYPE_CHECKING:
    from gsvrcodec.encoder.analysis import FrameStats

#: Costs of GOPs of 1, 2, ... frames that end with a frame, by the number of that frame.
_Costs = Callable[[int], NDArray[np.float64]]
#: Cost of a GOP of fewer frames than the shortest: more than that of any other.
_TOO_SHORT = 1e12


@dataclass(frozen=True, slots=True)
class GopLimits:
    """Bounds and price of adaptive GOPs."""

    shortest: int  #: frames, unless their shot is shorter
    longest: int  #: frames
    #: of a GOP: the squared error that its bits save elsewhere over its frames / the root of these
    #: frames, where detail and change are 1; None = GOPs end by the motion of frames, as published
    price: float | None = GOP_LENGTH.price


def adaptive(stats: Sequence[FrameStats], limits: GopLimits, bits: float) -> list[int]:
    """Return the frames of each GOP of a part of a shot.

    One picture for each GOP, whose places move by polynomials of degree 2, leaves least error in
    all, where each GOP counts for as much error as its bits save elsewhere. Where no number of GOPs
    keeps both bounds, the longest is kept.

    Args:
        stats: statistics of each frame; one at least.
        limits: bounds, and the price of a GOP.
        bits: those of each GOP / those of a key GOP.
    """
    lengths = np.arange(1, min(limits.longest, len(stats)) + 1)
    if limits.price is None:
        costs = _by_motion(stats, lengths, limits.longest)
    else:
        costs = _by_paths(stats, lengths, bits * limits.price)
    least, last = np.zeros(len(stats) + 1), np.zeros(len(stats) + 1, np.intp)
    bounded = _TOO_SHORT * (lengths < limits.shortest)
    for end in range(1, len(stats) + 1):
        before = least[max(0, end - len(lengths)) : end][::-1]
        found = before + (bounded + costs(end - 1))[: len(before)]
        last[end] = 1 + found.argmin()
        least[end] = found.min()
    ends = [len(stats)]
    while ends[-1]:
        ends.append(int(ends[-1] - last[ends[-1]]))
    return [end - begin for begin, end in pairwise(ends[::-1])]


def _by_paths(stats: Sequence[FrameStats], lengths: NDArray[np.intp], price: float) -> _Costs:
    """Error that a moving picture leaves, and the bits of a GOP.

    A GOP with much detail takes more bits. Where frames differ much from those before, although
    motion is compensated, more of the error stays, too.
    """
    detail = fmean(frame.detail for frame in stats) ** GOP_LENGTH.detail_power
    change = 1 + fmean(frame.change for frame in stats)
    own = price * detail * np.sqrt(lengths / change)
    left = np.zeros((len(stats), len(lengths)))
    for number, frame in enumerate(stats):
        if frame.left:
            known = (0, 1, *PATHS.lengths[: len(frame.left)])
            left[number] = lengths * np.interp(lengths, known, (0.0, 0.0, *frame.left))
        elif number:
            left[number] = left[number - 1]
    return lambda end: own + left[end]


def _by_motion(stats: Sequence[FrameStats], lengths: NDArray[np.intp], longest: int) -> _Costs:
    """As few GOPs as keep the motion that adds up in each of them in bounds, all of about as much.

    The motion of each frame counts, and 1 / the frames of the longest GOP.
    """
    filled = [frame.motion / GOP_LENGTH.motion + 1 / longest for frame in stats]
    total = np.concatenate([np.zeros(len(lengths)), np.cumsum(filled)])

    def costs(end: int) -> NDArray[np.float64]:
        own = total[end + len(lengths)] - total[end : end + len(lengths)][::-1]
        excess = np.maximum(0.0, own - 1 - 1e-9)
        return np.asarray(len(stats) + np.square(own) + len(stats) ** 2 * excess)

    return costs
