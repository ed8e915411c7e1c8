"""What each GOP gets: Gaussians, and a size or a quality to meet."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from statistics import fmean

import numpy as np

from gsvrcodec.encoder.analysis import FrameStats
from gsvrcodec.encoder.background import StillShot
from gsvrcodec.encoder.settings import EncodeSettings
from gsvrcodec.errors import UsageError
from gsvrcodec.model.gop import GAUSSIAN_PARAMETERS, TRIPLANE_CHANNELS, GridSize

#: Stored numbers a pixel and frame when nothing is asked for: the paper's 3M for its clip.
DEFAULT_DENSITY = 3e6 / (132 * 1280 * 640)
#: Bits of the payload for each Gaussian, all planes counted, at the best bargain between their
#: number and their steps: nearly the same from 0.01 to 0.1 bits a pixel.
_BITS_EACH = 70.0
#: Mean squared error = `_ERROR` x complexity / bpp^`_FALL`, where complexity is what changes from
#: frame to frame and a share of the detail; fitted to one clip, others differ by some dB.
_ERROR, _FALL, _DETAIL_SHARE = 0.05, 0.77, 0.06
#: Twice as many Gaussians come to so many dB more.
PSNR_OCTAVE = 2.3
#: 1 = every GOP gets what brings it to the same quality; 0 = every frame the same, which is best
#: for the mean of their PSNR.
_EVENNESS = 0.5
#: A GOP whose motion degree is less (pixels of the analysed frame), and that has more pixels of all
#: frames for each Gaussian, is better off with a coarser tri-plane: 4 % less bits on one clip.
_STILL, _SPARSE = 0.22, 2000.0
#: A tri-plane of more numbers than this part of the Gaussians' is dear: half as many cells gave 0.4
#: to 0.6 dB at equal size on three clips; with a smaller part they cost up to 0.2 dB.
_DEAR = 0.2
#: Least and most frames of the longest GOP, and what it times the bits a pixel comes to between.
_LONGEST_GOPS, _FRAMES_BPP = (32, 128), 3.2
#: Largest ratio of a GOP's share to the mean, and of the mean to it.
_MOST_UNEQUAL = 8.0
#: Bits for each Gaussian of a background, which has no motion.
_STILL_BITS_EACH = 48.0
#: Stored numbers of one Gaussian of a background.
_STILL_PARAMETERS = 8
#: What a background gets, of what it and its GOPs have together: s / (1 + s), where s = weight x
#: (still detail / other detail) x GOPs^power, so that the last bit of either buys as much; and
#: the most.
#: From 0.25 to 0.8 the weight hardly changes PSNR; less leaves more to what moves.
_BACKGROUND_WEIGHT, _BACKGROUND_POWER, _MOST_BACKGROUND = 0.3, -0.435, 0.75
#: Payload of a GOP that is hardly more than its tables.
LEAST_GOP_BYTES = 1500
_CELL_PX = 20.0
_GRID_RANGE = (4, 64)
_PAPER_GRID = (32, 16)


@dataclass(frozen=True, slots=True)
class Budget:
    """What one GOP is to take and to reach; the fields of a `GopTask`."""

    gaussians: int  #: N; with a quality to meet a first guess
    target_bytes: int | None = None  #: of its payload
    target_psnr: float | None = None  #: dB, mean of its frames
    grid: GridSize | None = None  #: Gx, Gy, Gt of its tri-plane; None = the usual


@dataclass(frozen=True, slots=True)
class Plan:
    """What all of a file gets."""

    gops: list[Budget]
    backgrounds: list[tuple[StillShot, Budget]]  #: in the order of the film


def longest_gop(
    steps: Sequence[FrameStats], size: tuple[int, int], settings: EncodeSettings, *, seconds: float
) -> int:
    """Frames of the longest adaptive GOP.

    A Gaussian that lives longer is paid for less often; but many of them in a long GOP take a long
    fit. So the fewer bits a frame gets, the longer GOPs are.

    Args:
        steps: Every frame as `analyse` measured it.
        size: Width and height, pixels.
        settings: What is asked for.
        seconds: Duration of the video.
    """
    shortest, longest = _LONGEST_GOPS
    if settings.gop_max is not None:
        return settings.gop_max
    if not settings.has_target or not steps:
        return max(shortest, settings.gop_min)
    if settings.target_psnr is not None:
        bpp = _bpp(steps, settings.target_psnr)
    else:
        _, total = _wanted(settings, size, len(steps), seconds, 0)
        bpp = 8 * total / (len(steps) * size[0] * size[1])
    return max(shortest, min(round(_FRAMES_BPP / bpp), longest), settings.gop_min)


def plan(
    gops: Sequence[range],
    steps: Sequence[FrameStats],
    size: tuple[int, int],
    settings: EncodeSettings,
    *,
    seconds: float,
    overhead: int,
    streams: int = 0,
    stills: Sequence[StillShot] = (),
) -> Plan:
    """Budgets of all GOPs and backgrounds; none depends on the result of another's fit.

    Args:
        gops: Frames of each.
        steps: Every frame as `analyse` measured it.
        size: Width and height, pixels.
        settings: What is asked for.
        seconds: Duration of the video.
        overhead: Bytes of the file that are neither payloads of GOPs nor copied streams.
        streams: Bytes of the copied streams; part of `target_size` alone.
        stills: Shots that get a background.

    Raises:
        UsageError: What is asked for is too little for this video.
    """
    if not settings.has_target:
        counts = [Budget(count) for count in allocate(gops, size, settings)]
        return _with_backgrounds(counts, stills, size, _STILL_PARAMETERS / GAUSSIAN_PARAMETERS)
    shots = [steps[gop.start : gop.stop] for gop in gops]
    sizes: list[int | None] = [None] * len(gops)
    if settings.target_psnr is not None:
        area = size[0] * size[1]
        bits = [len(shot) * area * _bpp(shot, settings.target_psnr) for shot in shots]
    else:
        option, total = _wanted(settings, size, gops[-1].stop, seconds, streams)
        sizes[:] = _shares(shots, total - overhead, option)
        bits = [8.0 * (each or 0) for each in sizes]
    budgets = []
    for each, most_bytes in zip(bits, sizes, strict=True):
        gaussians = min(max(1, round(each / _BITS_EACH)), most_gaussians(size))
        budgets.append(Budget(gaussians, most_bytes, settings.target_psnr))
    result = _with_backgrounds(budgets, stills, size, _STILL_BITS_EACH / _BITS_EACH)
    in_front = {position for shot, _ in result.backgrounds for position in shot.gops}
    gridded = [
        replace(budget, grid=_grid(shot, budget.gaussians, size, settings, in_front=n in in_front))
        for n, (shot, budget) in enumerate(zip(shots, result.gops, strict=True))
    ]
    return replace(result, gops=gridded)


def _with_backgrounds(
    budgets: Sequence[Budget], stills: Sequence[StillShot], size: tuple[int, int], price: float
) -> Plan:
    """Take from GOPs what their backgrounds get; a Gaussian of those costs `price` of another."""
    of_gops, of_backgrounds = list(budgets), []
    for shot in stills:
        own = of_gops[shot.gops.start : shot.gops.stop]
        shares = [_background_part(shot) * _free_part(budget) for budget in own]
        taken = [
            int(share * (budget.target_bytes or 0))
            for share, budget in zip(shares, own, strict=True)
        ]
        count = sum(share * budget.gaussians for share, budget in zip(shares, own, strict=True))
        gaussians = min(round(count / price), most_gaussians(size))
        sized = own[0].target_bytes is not None
        if not gaussians or (sized and sum(taken) < LEAST_GOP_BYTES):
            continue
        for position, share, less in zip(shot.gops, shares, taken, strict=True):
            budget = of_gops[position]
            left = max(1, round((1 - share) * budget.gaussians))
            of_gops[position] = replace(
                budget,
                gaussians=left,
                target_bytes=None if budget.target_bytes is None else budget.target_bytes - less,
            )
        quality = own[0].target_psnr
        if quality is not None:
            # What all GOPs share is worth more.
            quality += 1.0 - 10 * _BACKGROUND_POWER * math.log10(len(own))
        of_backgrounds.append((shot, Budget(gaussians, sum(taken) if sized else None, quality)))
    return Plan(of_gops, of_backgrounds)


def _free_part(budget: Budget) -> float:
    """What a GOP can give away: not what it needs for its tables."""
    if budget.target_bytes is None:
        return 1.0
    return max(0.0, 1 - 2 * LEAST_GOP_BYTES / budget.target_bytes)


def _background_part(shot: StillShot) -> float:
    """What a background gets of what it and its GOPs have together."""
    ratio = _BACKGROUND_WEIGHT * shot.share / max(1 - shot.share, 1e-3)
    ratio *= math.pow(len(shot.gops), _BACKGROUND_POWER)
    return min(ratio / (1 + ratio), _MOST_BACKGROUND)


def _wanted(
    settings: EncodeSettings, size: tuple[int, int], frames: int, seconds: float, streams: int
) -> tuple[str, float]:
    """The option that says how large the file is to be, and that size without streams, bytes."""
    if settings.bpp is not None:
        return f"--bpp {settings.bpp:g}", settings.bpp * size[0] * size[1] * frames / 8
    if settings.bitrate is not None:
        return f"--bitrate {settings.bitrate}", settings.bitrate * seconds / 8
    return f"--target-size {settings.target_size}", (settings.target_size or 0) - streams


def _shares(shots: Sequence[Sequence[FrameStats]], total: float, option: str) -> list[int]:
    """Bytes for each GOP, by length and by how hard its frames are."""
    spare = total - LEAST_GOP_BYTES * len(shots)
    if spare < 0:
        raise UsageError(
            f"{option} leaves {max(0, round(total))} bytes for {len(shots)} GOPs, which need "
            f"{LEAST_GOP_BYTES} each; raise it, use longer GOPs or a smaller picture"
        )
    needs = np.array([_complexity(shot) ** (_EVENNESS / _FALL) for shot in shots])
    lengths = np.array([len(shot) for shot in shots])
    mean = float((needs * lengths).sum()) / int(lengths.sum())
    shares = lengths * np.clip(needs, mean / _MOST_UNEQUAL, mean * _MOST_UNEQUAL)
    shares *= spare / shares.sum()
    return [LEAST_GOP_BYTES + int(share) for share in shares]


def _grid(
    shot: Sequence[FrameStats],
    gaussians: int,
    size: tuple[int, int],
    settings: EncodeSettings,
    *,
    in_front: bool,
) -> GridSize:
    """The usual tri-plane; half as many cells each way in space where it is dear, or also in time.

    The latter where little moves, and to the few Gaussians in front of a background.
    """
    gx, gy, gt = triplane_grid(size, len(shot), settings)
    dear = grid_parameters((gx, gy, gt)) > _DEAR * GAUSSIAN_PARAMETERS * gaussians
    still = fmean(step.motion for step in shot) < _STILL
    idle = in_front or (still and len(shot) * size[0] * size[1] > _SPARSE * gaussians)
    if dear or idle:
        gx, gy = -(-gx // 2), -(-gy // 2)
    return gx, gy, -(-gt // 2) if idle else gt


def _bpp(steps: Sequence[FrameStats], psnr: float) -> float:
    """Bits a pixel that frames may need for a quality, dB."""
    error = 255.0**2 / 10 ** (psnr / 10)
    return float((_ERROR * _complexity(steps) / error) ** (1 / _FALL))


def _complexity(steps: Sequence[FrameStats]) -> float:
    """How hard frames are to code, mean squared codes."""
    return fmean(step.change + _DETAIL_SHARE * step.detail + 1.0 for step in steps)


def most_gaussians(size: tuple[int, int]) -> int:
    """One for each two pixels of a frame."""
    return max(1, size[0] * size[1] // 2)


def triplane_grid(size: tuple[int, int], frames: int, settings: EncodeSettings) -> GridSize:
    """Gx, Gy, Gt of a GOP of `frames` frames of `size` (width, height); zeros for no tri-plane."""
    if settings.deform == "polynomial":
        return 0, 0, 0
    if settings.profile == "paper":
        return *_PAPER_GRID, max(1, frames // 2)
    low, high = _GRID_RANGE
    cells = max(size) / min(high, max(low, max(size) / _CELL_PX))
    gx, gy = (min(high, max(low, round(side / cells))) for side in size)
    return gx, gy, frames


def grid_parameters(grid: GridSize) -> int:
    """Stored numbers of a tri-plane."""
    gx, gy, gt = grid
    return TRIPLANE_CHANNELS * (gx * gy + gx * gt + gy * gt)


def allocate(gops: Sequence[range], size: tuple[int, int], settings: EncodeSettings) -> list[int]:
    """Gaussians of each GOP.

    Parameters are shared by length: every frame has as many. A GOP has at least one Gaussian, and
    never more than one for each two pixels of a frame.

    Raises:
        UsageError: `params` does not even hold the tri-planes.
    """
    width, height = size
    most = most_gaussians(size)
    if settings.gaussians is not None:
        return [settings.gaussians] * len(gops)
    frames = sum(len(gop) for gop in gops)
    total = settings.params or round(DEFAULT_DENSITY * width * height * frames)
    planes = [grid_parameters(triplane_grid(size, len(gop), settings)) for gop in gops]
    left = total - sum(planes)
    if settings.params is None:
        # The tri-planes of a small picture may take more than its share: half is for Gaussians.
        left = max(left, total // 2, GAUSSIAN_PARAMETERS * len(gops))
    elif left < GAUSSIAN_PARAMETERS * len(gops):
        raise UsageError(
            f"{total} parameters are too few: {len(gops)} GOPs need {sum(planes)} for their "
            f"deformation fields and {GAUSSIAN_PARAMETERS} for each Gaussian; "
            "raise --params or use longer GOPs"
        )
    spare = left // GAUSSIAN_PARAMETERS - len(gops)
    return [min(most, 1 + spare * len(gop) // frames) for gop in gops]
