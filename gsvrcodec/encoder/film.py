"""How a film is divided: sections, chains of GOPs, GOPs (paper, "Dynamic-aware Time Slicing")."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate, groupby, pairwise
from statistics import fmean
from typing import TYPE_CHECKING, Literal

import numpy as np

from gsvrcodec.encoder.film_target import FilmTarget
from gsvrcodec.encoder.gop_lengths import GopLimits, adaptive
from gsvrcodec.encoder.rate import bit_weights, qscale_at
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
    by_motion: bool = False  #: adaptive GOPs end by the motion of frames, as published
    effort: float = 1.0  #: visits of a frame / those of the quickest preset


@dataclass(frozen=True, slots=True)
class Section:
    """Frames that are planned together."""

    chains: list[Chain]  #: their numbers, by GOP
    seconds: float  #: that they last


def slice_gops(
    stats: Sequence[FrameStats],
    gop: int | Literal["adaptive"],
    bounds: GopLimits,
    chained: int | None = None,
    pays: Callable[[Chain, Chain], bool] = lambda chain, apart: True,
    lasts: Callable[[range], bool] = lambda gop: True,
    new: Callable[[range], float] = lambda span: 1.0,
) -> list[Chain]:
    """Frames of each GOP, by chain; no chain spans a cut.

    A fixed `gop` ends after so many frames. A shot is cut into as few chains as keep their longest,
    all of about the same length. Adaptive key GOPs take the place of chains that do not pay. A GOP
    in which too little of the picture lasts begins a chain of its own.

    Args:
        stats: statistics of every frame.
        gop: frames of each GOP, or by motion.
        bounds: of adaptive GOPs, and their price.
        chained: longest chain, frames; None = every GOP is a key GOP.
        pays: whether an adaptive chain is better than these key GOPs.
        lasts: whether enough of the picture is in a GOP as it was, so that it may be predicted.
        new: bits of GOPs of a chain / bits of key GOPs.
    """
    cuts = [number for number, frame in enumerate(stats) if frame.cut or not number]
    shots = [range(begin, end) for begin, end in pairwise([*cuts, len(stats)])]

    def cut(span: range, longest: int, bits: float = 1.0) -> list[range]:
        lengths = (
            [gop] * -(-len(span) // gop)
            if gop != "adaptive"
            else adaptive(stats[span.start : span.stop], replace(bounds, longest=longest), bits)
        )
        ends = accumulate(lengths, initial=span.start)
        return [range(begin, min(end, span.stop)) for begin, end in pairwise(ends)]

    if chained is None:
        return [[one] for shot in shots for one in cut(shot, bounds.longest)]
    longest = min(bounds.longest, chained)

    def chain(span: range) -> Chain:
        return cut(span, bounds.longest, new(span))

    def chain_pays(span: range) -> bool:
        return gop != "adaptive" or pays(chain(span), cut(span, longest))

    chains: list[Chain] = []
    for shot in shots:
        for worth_it, same in groupby(_evenly(shot, chained), chain_pays):
            spans = list(same)
            if worth_it:
                for span in spans:
                    chains += _where_it_lasts(chain(span), lasts)
            else:
                whole = range(spans[0].start, spans[-1].stop)
                chains += [[one] for one in cut(whole, longest)]
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
    bounds, chained = limits(bpp, len(stats), structure, seconds=seconds)
    if bounds.price is not None:
        qscale = qscale_at(stats, bpp) if bpp < math.inf else 1.0
        dearer = math.pow(qscale, GOP_LENGTH.qscale_power) * GOP_LENGTH.height / min(size)
        dearer *= math.pow(structure.effort, GOP_LENGTH.effort_power)
        bounds = replace(bounds, price=dearer * bounds.price)

    def pays(chain: Chain, apart: Chain) -> bool:
        """Whether a chain costs clearly less than key GOPs.

        Fast motion asks for short GOPs, and they follow it better than long ones.
        """
        if structure.parted or len(chain) == 1:
            return True  # They are key GOPs where that is better.
        fast = fmean(map(_pace, stats[chain[0].start : chain[-1].stop])) > CHAIN.fast
        return fast or sum(bit_weights(chain, stats, psnr)) < CHAIN.worth * len(apart)

    def changed(frames: range) -> float:
        """Share of the picture that is not as it was before these frames."""
        since, total = 0.0, 0.0  # the frames before: of this frame, of all frames so far
        for frame in stats[frames.start : frames.stop]:
            if frame.fast > ANALYSIS.rest:
                since = frame.changed_at(psnr)
            total += since
        return total / len(frames)

    # Of the picture, that may change in a predicted GOP.
    most = 1 - PREDICTION.kept if structure.parted else math.inf

    def lasts(frames: range) -> bool:
        """Whether as many Gaussians may be kept as a predicted GOP has to keep."""
        return changed(frames) <= most

    def new(span: range) -> float:
        """Bits of GOPs of a chain / bits of key GOPs, as far as they tell how long GOPs are."""
        part = changed(span)
        if part > most:
            return 1.0
        return math.pow(max(CHAIN.idle_bits, part), GOP_LENGTH.changed_power)

    return slice_gops(stats, structure.gop, bounds, chained, pays, lasts, new)


def _pace(frame: FrameStats) -> float:
    """Motion, of all and of what is fast before a picture that stands still, px."""
    unchanged = 1 - frame.changed_at(RATE.usual_psnr)
    return frame.motion + CHAIN.fast_share * unchanged * frame.fast


def limits(
    bpp: float, frames: int, structure: Structure, *, seconds: float
) -> tuple[GopLimits, int | None]:
    """Bounds of GOPs and of chains.

    Args:
        bpp: bits a pixel; inf = not known.
        frames: of the video.
        structure: which GOPs are asked for.
        seconds: duration of the video.

    Returns:
        Bounds of GOPs with the price at qscale 1, and frames of the longest chain; None = every GOP
        is a key GOP.
    """
    by_rate = min(round(GOP_LENGTH.frames_bpp / bpp), GOP_LENGTH.longest)
    longest = max(GOP_LENGTH.shortest, by_rate, structure.gop_min)
    price = None if structure.by_motion else GOP_LENGTH.price
    bounds = GopLimits(structure.gop_min, structure.gop_max or longest, price)
    if not structure.keyint:
        return bounds, None
    return bounds, max(1, round(structure.keyint * frames / seconds))
