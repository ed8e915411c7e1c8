"""Plan of an encode: the budget of every GOP, before the first is fitted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import fmean

import numpy as np

from gsvrcodec.encoder.analysis import FrameStats
from gsvrcodec.encoder.budget import (
    Budget,
    allocate,
    fittable,
    grid_parameters,
    halved,
    most_gaussians,
    triplane_grid,
)
from gsvrcodec.encoder.settings import EncodeSettings
from gsvrcodec.encoder.slicing import Chain
from gsvrcodec.encoder.tuned import ANALYSIS, CHAIN, GOP_LENGTH, RATE, TRIPLANE
from gsvrcodec.errors import UsageError
from gsvrcodec.model.gop import GAUSSIAN_PARAMETERS, GridSize


def gop_limits(
    stats: Sequence[FrameStats], size: tuple[int, int], settings: EncodeSettings, *, seconds: float
) -> tuple[int, float]:
    """Frames of the longest adaptive GOP, and motion at which a GOP ends.

    A Gaussian that lives longer is paid for less often, but follows less of the motion, and many
    Gaussians in a long GOP take a long fit. So GOPs are the longer the fewer bits a frame gets.

    Args:
        stats: Statistics of every frame.
        size: Width and height, pixels.
        settings: Of the encode.
        seconds: Duration of the video.

    Returns:
        Frames, and motion in pixels of the analysed frame.
    """
    bpp = math.inf
    if stats and settings.target_psnr is not None:
        bpp = _bpp(stats, settings.target_psnr)
    elif stats and settings.has_target:
        _, total = _wanted(settings, size, len(stats), seconds, 0)
        bpp = 8 * total / (len(stats) * size[0] * size[1])
    if settings.predicts:
        longer = min(max(1.0, CHAIN.longer_bpp / bpp), CHAIN.longer)
        longest = round(longer**CHAIN.longest_power * CHAIN.longest)
        threshold = longer * CHAIN.threshold
    else:
        by_rate = min(round(GOP_LENGTH.frames_bpp / bpp), GOP_LENGTH.longest)
        longest, threshold = max(GOP_LENGTH.shortest, by_rate), ANALYSIS.threshold
    return settings.gop_max or max(longest, settings.gop_min), threshold


def longest_chain(frames: int, settings: EncodeSettings, *, seconds: float) -> int:
    """Frames of the longest chain; 0 = every GOP is a key GOP."""
    if not settings.predicts or not frames:
        return 0
    return max(1, round(settings.keyint * frames / seconds))


def plan(
    chains: Sequence[Chain],
    stats: Sequence[FrameStats],
    size: tuple[int, int],
    settings: EncodeSettings,
    *,
    seconds: float,
    overhead: int,
    streams: int = 0,
) -> list[Budget]:
    """Budgets of all GOPs; none depends on the result of another's fit.

    Args:
        chains: Frames of each GOP.
        stats: Statistics of every frame.
        size: Width and height, pixels.
        settings: Of the encode.
        seconds: Duration of the video.
        overhead: Bytes of the file that are neither payloads of GOPs nor copied streams.
        streams: Bytes of the copied streams; part of `target_size` alone.

    Raises:
        UsageError: The size asked for is too little for this video.
    """
    if not settings.has_target:
        counts = allocate(chains, size, settings)
        return [Budget(n) for n, chain in zip(counts, chains, strict=True) for _ in chain]
    stats_of = [stats[chain[0].start : chain[-1].stop] for chain in chains]
    sizes: list[int | None] = [None] * len(chains)
    if settings.target_psnr is not None:
        area = size[0] * size[1]
        bits = [len(own) * area * _bpp(own, settings.target_psnr) for own in stats_of]
    else:
        option, total = _wanted(settings, size, chains[-1][-1].stop, seconds, streams)
        sizes[:] = _shares(stats_of, list(map(len, chains)), total - overhead, option)
        bits = [8.0 * (each or 0) for each in sizes]
    budgets = []
    for chain, whole, most_bytes in zip(chains, bits, sizes, strict=True):
        weights = bit_weights(chain, stats)
        gaussians = whole / (_gaussian_bits(chain) * sum(weights))
        most = min(most_gaussians(size), _most_gaussians(chain, weights, settings))
        gaussians = max(1, round(min(gaussians, most)))
        for number, (gop, weight) in enumerate(zip(chain, weights, strict=True)):
            own = stats[gop.start : gop.stop]
            share = None if most_bytes is None else int(most_bytes * weight / sum(weights))
            grid = _grid(own, gaussians, size, settings, predicted=number > 0)
            budgets.append(Budget(gaussians, share, settings.target_psnr, grid))
    return budgets


def bit_weights(chain: Chain, stats: Sequence[FrameStats]) -> list[float]:
    """Bits of each GOP of a chain, in those of its key GOP."""
    key = _need(stats[chain[0].start : chain[0].stop])
    weights = [1.0]
    for gop in chain[1:]:
        own = stats[gop.start : gop.stop]
        moving = fmean(frame.moving for frame in own)
        changing = CHAIN.idle_bits + CHAIN.moving_bits * moving
        weights.append(changing * (_need(own) / key) ** CHAIN.evenness)
    return weights


def _most_gaussians(chain: Chain, weights: Sequence[float], settings: EncodeSettings) -> float:
    """Most Gaussians in each GOP of a chain that the wall time of an encode suffices for."""
    if settings.time_budget is None:
        return math.inf
    gops, changing = (chain[1:], fmean(weights[1:])) if len(chain) > 1 else (chain, 1.0)
    return fittable(settings.time_budget * fmean(map(len, gops)), settings) / changing


def _gaussian_bits(chain: Chain) -> float:
    """Bits of the payload of a key GOP for each Gaussian, at the best trade."""
    return RATE.gaussian_bits if len(chain) == 1 else CHAIN.gaussian_bits


def _wanted(
    settings: EncodeSettings, size: tuple[int, int], frames: int, seconds: float, streams: int
) -> tuple[str, float]:
    """The argument that says how large the file is to be, and that size without streams, bytes."""
    if settings.bpp is not None:
        return f"`bpp={settings.bpp:g}`", settings.bpp * size[0] * size[1] * frames / 8
    if settings.bitrate is not None:
        return f"`bitrate={settings.bitrate}`", settings.bitrate * seconds / 8
    return f"`target_size={settings.target_size}`", (settings.target_size or 0) - streams


def _shares(
    stats_of: Sequence[Sequence[FrameStats]], gops: Sequence[int], total: float, option: str
) -> list[int]:
    """Bytes of each chain of so many GOPs, by its length and the complexity of its frames."""
    spare = total - RATE.least_gop_bytes * sum(gops)
    if spare < 0:
        raise UsageError(
            f"{option} leaves {max(0, round(total))} bytes for {sum(gops)} GOPs, which need "
            f"{RATE.least_gop_bytes} each; raise it, use longer GOPs or a smaller picture"
        )
    needs = np.array([_need(own) for own in stats_of])
    lengths = np.array([len(own) for own in stats_of])
    mean = float((needs * lengths).sum()) / int(lengths.sum())
    shares = lengths * np.clip(needs, mean / RATE.most_unequal, mean * RATE.most_unequal)
    shares *= spare / shares.sum()
    return [RATE.least_gop_bytes * n + int(share) for n, share in zip(gops, shares, strict=True)]


def _grid(
    stats: Sequence[FrameStats],
    gaussians: int,
    size: tuple[int, int],
    settings: EncodeSettings,
    *,
    predicted: bool,
) -> GridSize:
    """The usual tri-plane; half as many cells a side in space where it is dear, or also in time.

    The latter where little moves. A predicted GOP always has half as many cells in space.
    """
    gx, gy, gt = triplane_grid(size, len(stats), settings)
    dear = grid_parameters((gx, gy, gt)) > TRIPLANE.dear * GAUSSIAN_PARAMETERS * gaussians
    slow = fmean(frame.motion for frame in stats) < TRIPLANE.slow
    idle = slow and len(stats) * size[0] * size[1] > TRIPLANE.sparse * gaussians
    if dear or idle or predicted:
        gx, gy, gt = halved((gx, gy, gt))
    return gx, gy, -(-gt // 2) if idle else gt


def _bpp(stats: Sequence[FrameStats], psnr: float) -> float:
    """Bits a pixel that frames may need for a quality, dB."""
    error = 255.0**2 / 10 ** (psnr / 10)
    return float((RATE.error * _complexity(stats) / error) ** (1 / RATE.fall))


def _need(stats: Sequence[FrameStats]) -> float:
    """Bits that frames should get, up to a factor."""
    need: float = _complexity(stats) ** (RATE.evenness / RATE.fall)
    return need


def _complexity(stats: Sequence[FrameStats]) -> float:
    """Complexity of frames, squared 8-bit codes."""
    return fmean(frame.change + RATE.detail_share * frame.detail + 1.0 for frame in stats)
