"""Plan of an encode: the budget of every GOP of a section, before the first is fitted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from statistics import fmean

import numpy as np

from gsvrcodec.encoder.analysis import FrameStats
from gsvrcodec.encoder.budget import (
    Budget,
    allocate,
    fittable,
    halved,
    most_gaussians,
    triplane_grid,
)
from gsvrcodec.encoder.rate import (
    bit_weights,
    bpp_at,
    bpp_for,
    expected_psnr,
    qscale_of,
    wanted_bytes,
)
from gsvrcodec.encoder.settings import EncodeSettings
from gsvrcodec.encoder.slicing import Chain
from gsvrcodec.encoder.tuned import CHAIN, RATE, TRIPLANE
from gsvrcodec.errors import UsageError
from gsvrcodec.fit.slope import Slope
from gsvrcodec.model.attributes import gaussian_parameters, triplane_channels
from gsvrcodec.model.gop import GridSize


def plan(
    chains: Sequence[Chain],
    stats: Sequence[FrameStats],
    size: tuple[int, int],
    settings: EncodeSettings,
    *,
    seconds: float,
    overhead: int = 0,
    streams: int = 0,
) -> list[Budget]:
    """Budgets of all GOPs of a section; none depends on the result of another's fit.

    Args:
        chains: Frames of each GOP, one after another.
        stats: Statistics of every frame of the film up to the end of the section.
        size: Width and height, pixels.
        settings: Of the encode.
        seconds: Duration of the section.
        overhead: Bytes of the file that are neither payloads of GOPs nor copied streams; for a
            size alone, for which the section is the whole film.
        streams: Bytes of the copied streams; part of `target_size` alone.

    Raises:
        UsageError: The size asked for is too little for this video.
    """
    if not settings.has_target:
        counts = allocate(chains, size, settings)
        return [Budget(n) for n, chain in zip(counts, chains, strict=True) for _ in chain]
    section = stats[chains[0][0].start : chains[-1][-1].stop]
    psnr = expected_psnr(section, size, settings, seconds=seconds)
    stats_of = [stats[chain[0].start : chain[-1].stop] for chain in chains]
    area = size[0] * size[1]
    qscale = None if settings.quality is None else qscale_of(settings.quality)
    if settings.target_psnr is not None:
        bits = [len(own) * area * bpp_for(own, settings.target_psnr) for own in stats_of]
    elif qscale is not None:
        bits = [len(own) * area * bpp_at(own, qscale) for own in stats_of]
    else:
        option, total = wanted_bytes(settings, size, chains[-1][-1].stop, seconds, streams)
        sizes = _shares(stats_of, list(map(len, chains)), total - overhead, option)
        bits = [8.0 * each for each in sizes]
    budgets = []
    for chain, whole in zip(chains, bits, strict=True):
        weights = bit_weights(chain, stats, psnr)
        least = min(8.0 * RATE.least_gop_bytes, whole / len(chain))
        spare = whole - least * len(chain)
        shares = [least + spare * weight / sum(weights) for weight in weights]
        most = round(min(most_gaussians(size), _most_gaussians(chain, weights, settings)))
        gaussians = max(1, min(round(shares[0] / _gaussian_bits(chain)), most))
        frames = sum(map(len, chain))
        for number, (gop, bits_of_gop) in enumerate(zip(chain, shares, strict=True)):
            grid = _grid(len(gop), gaussians, size, settings, predicted=number > 0)
            budget = Budget(gaussians, target_psnr=settings.target_psnr, grid=grid)
            if number:
                changing = min(1.0, weights[number])
                cost = CHAIN.idle_step + (1 - CHAIN.idle_step) * changing
                budget = replace(budget, step_cost=cost)
            if qscale is not None:
                lasting = 1.0 if number else frames / len(gop) / sum(weights)
                budget = replace(budget, slope=Slope(qscale, most, max(1.0, lasting)))
            elif settings.target_psnr is None:
                budget = replace(budget, target_bytes=int(bits_of_gop / 8))
            budgets.append(budget)
    return budgets


def _most_gaussians(chain: Chain, weights: Sequence[float], settings: EncodeSettings) -> float:
    """Most Gaussians in each GOP of a chain that the wall time of an encode suffices for."""
    if settings.time_budget is None:
        return math.inf
    gops, changing = (chain[1:], fmean(weights[1:])) if len(chain) > 1 else (chain, 1.0)
    return fittable(settings.time_budget * fmean(map(len, gops)), settings) / changing


def _gaussian_bits(chain: Chain) -> float:
    """Bits of the payload of a key GOP for each Gaussian, at the best trade."""
    return RATE.gaussian_bits if len(chain) == 1 else CHAIN.gaussian_bits


def _shares(
    stats_of: Sequence[Sequence[FrameStats]], gops: Sequence[int], total: float, option: str
) -> list[int]:
    """Bytes of each chain of so many GOPs: as many bits as are worth the same in all of them."""
    spare = total - RATE.least_gop_bytes * sum(gops)
    if spare < 0:
        raise UsageError(
            f"{option} leaves {max(0, round(total))} bytes for {sum(gops)} GOPs, which need "
            f"{RATE.least_gop_bytes} each; raise it, use longer GOPs or a smaller picture"
        )
    needs = np.array([bpp_at(own, 1.0) for own in stats_of])
    lengths = np.array([len(own) for own in stats_of])
    mean = float((needs * lengths).sum()) / int(lengths.sum())
    shares = lengths * np.clip(needs, mean / RATE.most_unequal, mean * RATE.most_unequal)
    shares *= spare / shares.sum()
    return [RATE.least_gop_bytes * n + int(share) for n, share in zip(gops, shares, strict=True)]


def _grid(
    frames: int,
    gaussians: int,
    size: tuple[int, int],
    settings: EncodeSettings,
    *,
    predicted: bool,
) -> GridSize:
    """The usual tri-plane, with fewer cells in space where its numbers would be dear.

    A predicted GOP has at most half as many cells a side.
    """
    usual = triplane_grid(size, frames, settings)
    gx, gy, gt = halved(usual) if predicted else usual
    if not gx:
        return usual
    numbers = TRIPLANE.share * gaussian_parameters(settings.blending) * gaussians
    most = numbers / triplane_channels(settings.blending)
    # With s times the cells a side, a channel has s^2 plane + s lines numbers.
    plane, lines = gx * gy, gt * (gx + gy)
    side = (math.sqrt(lines**2 + 4 * plane * most) - lines) / (2 * plane)
    least = TRIPLANE.cells[0]
    gx, gy = (min(n, max(least, round(side * n))) for n in (gx, gy))
    return gx, gy, gt
