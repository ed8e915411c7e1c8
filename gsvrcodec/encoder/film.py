"""How a film is divided: sections, chains of GOPs, GOPs (paper, "Dynamic-aware Time Slicing")."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import groupby, pairwise
from statistics import fmean
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.encoder.film_target import FilmTarget
from gsvrcodec.encoder.rate import bit_weights
from gsvrcodec.encoder.tuned import ANALYSIS, CHAIN, GOP_LENGTH, RATE
from gsvrcodec.fit.tuned import PREDICTION

if TYPE_CHECKING:
    from gsvrcodec.encoder.analysis import FrameStats

#: Frames of GOPs of which each but the first may be predicted from the one before.
Chain = list[range]


@dataclass(frozen=True, slots=True)
class Structure:
    """Which GOPs are asked for; see `EncodeSettings`."""

    gop: int | Literal["adaptive"]  #: frames in a GOP, or by motion
    gop_min: int  #: shortest adaptive GOP between cuts, frames
    gop_max: int | None  #: longest adaptive GOP, frames; None = by the bits
    keyint: float  #: longest time from one key GOP to the next, seconds; 0 = all are key GOPs
    parted: bool = False  #: GOPs of which too little lasts are chains of their own


@dataclass(frozen=True, slots=True)
class Section:
    """Frames that are planned together."""

    chains: list[Chain]  #: their numbers, by GOP
    seconds: float  #: that they last


@dataclass(frozen=True, slots=True)
class GopLimits:
    """When an adaptive GOP ends."""

    shortest: int  #: frames, unless its shot is shorter
    longest: int  #: frames
    motion: float = ANALYSIS.threshold  #: accumulated, px of the analysed frame
    #: what the fastest motion of a frame adds to its mean motion, where all the rest stands still:
    #: short GOPs are cheap there
    fast_share: float = 0.0


@dataclass(frozen=True, slots=True)
class ChainLimits:
    """When a chain ends, and each of its GOPs."""

    longest: int  #: frames
    gops: GopLimits


def slice_gops(
    stats: Sequence[FrameStats],
    gop: int | Literal["adaptive"],
    alone: GopLimits,
    chained: ChainLimits | None = None,
    pays: Callable[[Chain, float], bool] = lambda chain, apart: True,
    lasts: Callable[[range], bool] = lambda gop: True,
) -> list[Chain]:
    """Frames of each GOP, by chain; no chain spans a cut.

    A fixed `gop` ends after so many frames. For an adaptive one each frame adds its motion over
    the motion at which a GOP ends, and 1 / the frames of the longest; a span is cut into as few
    GOPs as keep that sum within 1, all of about the same sum, and none of fewer frames than the
    shortest unless the span is.

    A shot is cut into as few chains as keep their longest, all of about the same length. Adaptive
    key GOPs take the place of chains that do not pay. A GOP in which too little of the picture
    lasts begins a chain of its own.

    Args:
        stats: statistics of every frame.
        gop: frames of each GOP, or by motion.
        alone: of key GOPs from which none is predicted.
        chained: of chains; None = every GOP is a key GOP.
        pays: whether an adaptive chain is better than so many key GOPs, a fraction included.
        lasts: whether enough of the picture is in a GOP as it was, so that it may be predicted.
    """
    cuts = [number for number, frame in enumerate(stats) if frame.cut or not number]
    shots = [range(begin, end) for begin, end in pairwise([*cuts, len(stats)])]
    if chained is None:
        return [[one] for shot in shots for one in _cut(shot, stats, gop, alone)]
    bounded = replace(alone, longest=min(alone.longest, chained.longest))

    def chain_pays(span: range) -> bool:
        if gop != "adaptive":
            return True
        apart = float(_progress([stats[n] for n in span], alone)[-1])
        return pays(_cut(span, stats, gop, chained.gops), max(1.0, apart))

    chains: list[Chain] = []
    for shot in shots:
        for worth_it, same in groupby(_evenly(shot, chained.longest), chain_pays):
            spans = list(same)
            if worth_it:
                for span in spans:
                    chains += _where_it_lasts(_cut(span, stats, gop, chained.gops), lasts)
            else:
                whole = range(spans[0].start, spans[-1].stop)
                chains += [[one] for one in _cut(whole, stats, gop, bounded)]
    return chains


def _where_it_lasts(gops: Chain, lasts: Callable[[range], bool]) -> list[Chain]:
    """Cut a chain where too little of the picture lasts."""
    chains = [gops[:1]]
    for gop in gops[1:]:
        if lasts(gop):
            chains[-1].append(gop)
        else:
            chains.append([gop])
    return chains


def _evenly(shot: range, longest: int) -> list[range]:
    parts = -(-len(shot) // longest)
    bounds = np.linspace(shot.start, shot.stop, parts + 1).round().astype(int).tolist()
    return [range(begin, end) for begin, end in pairwise(bounds)]


def _cut(
    span: range, stats: Sequence[FrameStats], gop: int | Literal["adaptive"], limits: GopLimits
) -> list[range]:
    """Frames of each GOP of a span."""
    if gop == "adaptive":
        lengths = _adaptive_lengths([stats[n] for n in span], limits)
    else:
        lengths = [min(gop, len(span) - at) for at in range(0, len(span), gop)]
    ends = np.cumsum([span.start, *lengths]).tolist()
    return [range(first, after) for first, after in pairwise(ends)]


def pace(frame: FrameStats, limits: GopLimits) -> float:
    """Motion that counts for the length of a GOP, px of the analysed frame."""
    unchanged = 1 - frame.changed_at(RATE.usual_psnr)
    return frame.motion + limits.fast_share * unchanged * frame.fast


def _progress(stats: Sequence[FrameStats], limits: GopLimits) -> NDArray[np.float64]:
    """Return how many GOPs the frames up to each one fill, (F,)."""
    motion = np.cumsum([pace(frame, limits) for frame in stats])
    return motion / limits.motion + np.arange(1, len(stats) + 1) / limits.longest


def _adaptive_lengths(stats: Sequence[FrameStats], limits: GopLimits) -> list[int]:
    frames, minimum, maximum = len(stats), limits.shortest, limits.longest
    total = _progress(stats, limits)
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


def divided(
    stats: Sequence[FrameStats],
    size: tuple[int, int],
    structure: Structure,
    target: FilmTarget,
    *,
    seconds: float,
) -> list[Chain]:
    """Frames of each GOP, by chain.

    A Gaussian that lives longer is paid for less often, but follows less of the motion, and many
    Gaussians in a long GOP take a long fit. So GOPs are the longer the fewer bits a frame gets.

    Args:
        stats: statistics of every frame.
        size: width and height, pixels.
        structure: which GOPs are asked for.
        target: what the file is to take or to reach.
        seconds: duration of the video.
    """
    if not stats:
        return []
    bpp, psnr = target.bpp(stats, size, seconds), target.psnr(stats, size, seconds)
    alone, chained = limits(bpp, len(stats), structure, seconds=seconds)

    def pays(chain: Chain, apart: float) -> bool:
        """Whether a chain costs clearly less than so many key GOPs.

        Fast motion asks for short GOPs, and they follow it better than long ones.
        """
        if len(chain) == 1:
            return True  # It is a key GOP.
        assert chained is not None
        frames = stats[chain[0].start : chain[-1].stop]
        fast = fmean(pace(frame, chained.gops) for frame in frames) > CHAIN.fast
        return fast or sum(bit_weights(chain, stats, psnr)) < CHAIN.worth * apart

    def lasts(gop: range) -> bool:
        """Whether as many Gaussians may be kept as a predicted GOP has to keep."""
        if not structure.parted:
            return True
        since, changed = 0.0, 0.0  # the GOP before: of this frame, of all frames so far
        for frame in stats[gop.start : gop.stop]:
            if frame.fast > ANALYSIS.rest:
                since = frame.changed_at(psnr)
            changed += since / len(gop)
        return 1 - changed >= PREDICTION.kept

    return slice_gops(stats, structure.gop, alone, chained, pays, lasts)


def limits(
    bpp: float, frames: int, structure: Structure, *, seconds: float
) -> tuple[GopLimits, ChainLimits | None]:
    """When GOPs and chains end.

    Args:
        bpp: bits a pixel; inf = not known.
        frames: of the video.
        structure: which GOPs are asked for.
        seconds: duration of the video.

    Returns:
        Limits of key GOPs from which none is predicted, and of chains; None = every GOP is a key
        GOP.
    """

    def gops(longest: int, motion: float, fast_share: float = 0.0) -> GopLimits:
        longest = structure.gop_max or max(longest, structure.gop_min)
        return GopLimits(structure.gop_min, longest, motion, fast_share)

    by_rate = min(round(GOP_LENGTH.frames_bpp / bpp), GOP_LENGTH.longest)
    alone = gops(max(GOP_LENGTH.shortest, by_rate), ANALYSIS.threshold)
    if not structure.keyint:
        return alone, None
    longer = min(max(1.0, CHAIN.longer_bpp / bpp), CHAIN.longer)
    shorter = max(min(1.0, CHAIN.shorter_bpp / bpp), CHAIN.shorter)
    longest = round(longer**CHAIN.longest_power * CHAIN.longest)
    chained = gops(longest, longer * shorter * CHAIN.threshold, CHAIN.fast_share)
    return alone, ChainLimits(max(1, round(structure.keyint * frames / seconds)), chained)
