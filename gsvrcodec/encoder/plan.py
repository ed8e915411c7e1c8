"""Plan of an encode: the budget of every GOP and background, before the first is fitted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from statistics import fmean

import numpy as np

from gsvrcodec.encoder.analysis import FrameStats
from gsvrcodec.encoder.background import StaticRun
from gsvrcodec.encoder.budget import (
    Budget,
    allocate,
    grid_parameters,
    most_gaussians,
    triplane_grid,
)
from gsvrcodec.encoder.settings import EncodeSettings
from gsvrcodec.encoder.tuned import BACKGROUND, GOP_LENGTH, RATE, TRIPLANE
from gsvrcodec.errors import UsageError
from gsvrcodec.model.background import BACKGROUND_PARAMETERS
from gsvrcodec.model.gop import GAUSSIAN_PARAMETERS, GridSize


@dataclass(frozen=True, slots=True)
class PlannedBackground:
    """A background to be fitted."""

    run: StaticRun  #: the GOPs that may show it
    budget: Budget


@dataclass(frozen=True, slots=True)
class Plan:
    """Budgets of a whole file."""

    gops: list[Budget]
    backgrounds: list[PlannedBackground]  #: in the order of the film


def longest_gop(
    stats: Sequence[FrameStats], size: tuple[int, int], settings: EncodeSettings, *, seconds: float
) -> int:
    """Frames of the longest adaptive GOP.

    A Gaussian that lives longer is paid for less often; but many Gaussians in a long GOP take a
    long fit. So GOPs are the longer the fewer bits a frame gets.

    Args:
        stats: Statistics of every frame.
        size: Width and height, pixels.
        settings: Of the encode.
        seconds: Duration of the video.
    """
    if settings.gop_max is not None:
        return settings.gop_max
    if not settings.has_target or not stats:
        return max(GOP_LENGTH.shortest, settings.gop_min)
    if settings.target_psnr is not None:
        bpp = _bpp(stats, settings.target_psnr)
    else:
        _, total = _wanted(settings, size, len(stats), seconds, 0)
        bpp = 8 * total / (len(stats) * size[0] * size[1])
    by_rate = min(round(GOP_LENGTH.frames_bpp / bpp), GOP_LENGTH.longest)
    return max(GOP_LENGTH.shortest, by_rate, settings.gop_min)


def plan(
    gops: Sequence[range],
    stats: Sequence[FrameStats],
    size: tuple[int, int],
    settings: EncodeSettings,
    *,
    seconds: float,
    overhead: int,
    streams: int = 0,
    runs: Sequence[StaticRun] = (),
) -> Plan:
    """Budgets of all GOPs and backgrounds; none depends on the result of another's fit.

    Args:
        gops: Frames of each GOP.
        stats: Statistics of every frame.
        size: Width and height, pixels.
        settings: Of the encode.
        seconds: Duration of the video.
        overhead: Bytes of the file that are neither payloads of GOPs nor copied streams.
        streams: Bytes of the copied streams; part of `target_size` alone.
        runs: Static runs that may get a background.

    Raises:
        UsageError: The size asked for is too little for this video.
    """
    if not settings.has_target:
        counts = [Budget(count) for count in allocate(gops, size, settings)]
        return _with_backgrounds(counts, runs, size, BACKGROUND_PARAMETERS / GAUSSIAN_PARAMETERS)
    stats_of = [stats[gop.start : gop.stop] for gop in gops]
    sizes: list[int | None] = [None] * len(gops)
    if settings.target_psnr is not None:
        area = size[0] * size[1]
        bits = [len(own) * area * _bpp(own, settings.target_psnr) for own in stats_of]
    else:
        option, total = _wanted(settings, size, gops[-1].stop, seconds, streams)
        sizes[:] = _shares(stats_of, total - overhead, option)
        bits = [8.0 * (each or 0) for each in sizes]
    budgets = []
    for each, most_bytes in zip(bits, sizes, strict=True):
        gaussians = min(max(1, round(each / RATE.gaussian_bits)), most_gaussians(size))
        budgets.append(Budget(gaussians, most_bytes, settings.target_psnr))
    price = BACKGROUND.gaussian_bits / RATE.gaussian_bits
    result = _with_backgrounds(budgets, runs, size, price)
    in_front = {position for planned in result.backgrounds for position in planned.run.gops}
    gridded = [
        replace(budget, grid=_grid(own, budget.gaussians, size, settings, in_front=n in in_front))
        for n, (own, budget) in enumerate(zip(stats_of, result.gops, strict=True))
    ]
    return replace(result, gops=gridded)


def _with_backgrounds(
    budgets: Sequence[Budget], runs: Sequence[StaticRun], size: tuple[int, int], price: float
) -> Plan:
    """Give the backgrounds of runs a part of their GOPs' budgets.

    Args:
        budgets: Of all GOPs, without backgrounds.
        runs: Static runs.
        size: Width and height, pixels.
        price: Of a background's Gaussian, in those of a GOP.
    """
    gops, backgrounds = list(budgets), []
    for run in runs:
        own = gops[run.gops.start : run.gops.stop]
        shares = [_background_share(run) * _free_share(budget) for budget in own]
        taken = [
            int(share * (budget.target_bytes or 0))
            for share, budget in zip(shares, own, strict=True)
        ]
        count = sum(share * budget.gaussians for share, budget in zip(shares, own, strict=True))
        gaussians = min(round(count / price), most_gaussians(size))
        sized = own[0].target_bytes is not None
        if not gaussians or (sized and sum(taken) < RATE.least_gop_bytes):
            continue
        for position, share, less in zip(run.gops, shares, taken, strict=True):
            budget = gops[position]
            left = max(1, round((1 - share) * budget.gaussians))
            gops[position] = replace(
                budget,
                gaussians=left,
                target_bytes=None if budget.target_bytes is None else budget.target_bytes - less,
            )
        quality = own[0].target_psnr
        if quality is not None:
            quality += BACKGROUND.gain - 10 * BACKGROUND.power * math.log10(len(own))
        budget = Budget(gaussians, sum(taken) if sized else None, quality)
        backgrounds.append(PlannedBackground(run, budget))
    return Plan(gops, backgrounds)


def _free_share(budget: Budget) -> float:
    """Fraction of a GOP's bytes that it can give away: all but twice its tables."""
    if budget.target_bytes is None:
        return 1.0
    return max(0.0, 1 - 2 * RATE.least_gop_bytes / budget.target_bytes)


def _background_share(run: StaticRun) -> float:
    """Fraction of the bits of a run, background and GOPs together, that its background gets."""
    ratio = BACKGROUND.weight * run.share / max(1 - run.share, 1e-3)
    ratio *= math.pow(len(run.gops), BACKGROUND.power)
    return min(ratio / (1 + ratio), BACKGROUND.most)


def _wanted(
    settings: EncodeSettings, size: tuple[int, int], frames: int, seconds: float, streams: int
) -> tuple[str, float]:
    """The argument that says how large the file is to be, and that size without streams, bytes."""
    if settings.bpp is not None:
        return f"`bpp={settings.bpp:g}`", settings.bpp * size[0] * size[1] * frames / 8
    if settings.bitrate is not None:
        return f"`bitrate={settings.bitrate}`", settings.bitrate * seconds / 8
    return f"`target_size={settings.target_size}`", (settings.target_size or 0) - streams


def _shares(stats_of: Sequence[Sequence[FrameStats]], total: float, option: str) -> list[int]:
    """Bytes of each GOP, by its length and the complexity of its frames."""
    spare = total - RATE.least_gop_bytes * len(stats_of)
    if spare < 0:
        raise UsageError(
            f"{option} leaves {max(0, round(total))} bytes for {len(stats_of)} GOPs, which need "
            f"{RATE.least_gop_bytes} each; raise it, use longer GOPs or a smaller picture"
        )
    needs = np.array([_complexity(own) ** (RATE.evenness / RATE.fall) for own in stats_of])
    lengths = np.array([len(own) for own in stats_of])
    mean = float((needs * lengths).sum()) / int(lengths.sum())
    shares = lengths * np.clip(needs, mean / RATE.most_unequal, mean * RATE.most_unequal)
    shares *= spare / shares.sum()
    return [RATE.least_gop_bytes + int(share) for share in shares]


def _grid(
    stats: Sequence[FrameStats],
    gaussians: int,
    size: tuple[int, int],
    settings: EncodeSettings,
    *,
    in_front: bool,
) -> GridSize:
    """The usual tri-plane; half as many cells a side in space where it is dear, or also in time.

    The latter where little moves, and for the few Gaussians in front of a background.
    """
    gx, gy, gt = triplane_grid(size, len(stats), settings)
    dear = grid_parameters((gx, gy, gt)) > TRIPLANE.dear * GAUSSIAN_PARAMETERS * gaussians
    slow = fmean(frame.motion for frame in stats) < TRIPLANE.slow
    idle = in_front or (slow and len(stats) * size[0] * size[1] > TRIPLANE.sparse * gaussians)
    if dear or idle:
        gx, gy = -(-gx // 2), -(-gy // 2)
    return gx, gy, -(-gt // 2) if idle else gt


def _bpp(stats: Sequence[FrameStats], psnr: float) -> float:
    """Bits a pixel that frames may need for a quality, dB."""
    error = 255.0**2 / 10 ** (psnr / 10)
    return float((RATE.error * _complexity(stats) / error) ** (1 / RATE.fall))


def _complexity(stats: Sequence[FrameStats]) -> float:
    """Complexity of frames, squared 8-bit codes."""
    return fmean(frame.change + RATE.detail_share * frame.detail + 1.0 for frame in stats)
