"""The budget of each GOP: Gaussians, tri-plane, a size or a quality to meet."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from statistics import fmean

from gsvrcodec.encoder.analysis import FrameStats
from gsvrcodec.encoder.film import Chain
from gsvrcodec.encoder.film_target import Aim, Numbers
from gsvrcodec.encoder.rate import bit_weights, lasting
from gsvrcodec.encoder.settings import EncodeSettings, Execution
from gsvrcodec.encoder.tuned import CHAIN, RATE
from gsvrcodec.errors import UsageError
from gsvrcodec.fit.start import affordable
from gsvrcodec.fit.target import Count, Quality, Size, Slope, Target
from gsvrcodec.fit.tuned import TRIPLANE
from gsvrcodec.model.attributes import gaussian_parameters, triplane_channels
from gsvrcodec.model.gop import GridSize
from gsvrcodec.model.reconstruction import Blending
from gsvrcodec.render.device import choose_device
from gsvrcodec.render.native import resolve_threads

#: Stored numbers a pixel and frame by default: the paper's 3M for its clip.
DEFAULT_DENSITY = 3e6 / (132 * 1280 * 640)
#: Cells of the paper's tri-plane in x and y.
_PAPER_GRID = (32, 16)


@dataclass(frozen=True, slots=True)
class Budget:
    """What one GOP is to take and to reach."""

    gaussians: int  #: N; for a quality or a slope a first guess
    target: Target = field(default_factory=Count)
    grid: GridSize | None = None  #: Gx, Gy, Gt of the tri-plane; None = the usual
    step_cost: float = 1.0  #: time of an optimiser step / that in the key GOP of the chain
    #: bytes that the payload may take, and those of a plate beside them; 0 = any
    bytes: int = 0
    plate_bytes: int = 0
    predicted: bool = False  #: whether it was worth being predicted in a first pass

    @property
    def slope(self) -> Slope | None:
        """The slope that is asked for; None = something else is."""
        match self.target:
            case Slope() as slope:
                return slope
            case Size(slope=slope) | Quality(slope=slope):
                return slope
        return None

    def beside_plate(self, slope: Slope, size: int) -> Budget:
        """Return a budget with another slope, and with so many bytes more for a plate."""
        target: Target = slope
        match self.target:
            case Size(bytes=own):
                target = Size(own + size, slope)
            case Quality(psnr=psnr):
                target = Quality(psnr, slope)
        return replace(self, target=target)


def most_gaussians(size: tuple[int, int]) -> int:
    """One Gaussian for each two pixels of a frame."""
    return max(1, size[0] * size[1] // 2)


def fittable(seconds: float, execution: Execution) -> float:
    """Most Gaussians that a fit of so many seconds suffices for, on a CPU.

    With more of them a predicted GOP takes too few steps, and looks worse at more bits.
    """
    if choose_device(execution.device) != "cpu":
        return math.inf
    return seconds * resolve_threads(execution.threads) * CHAIN.fitted_a_second


def triplane_grid(size: tuple[int, int], frames: int, settings: EncodeSettings) -> GridSize:
    """Gx, Gy, Gt of a GOP of `frames` frames of `size` (width, height); zeros for no tri-plane."""
    if settings.deform == "polynomial":
        return 0, 0, 0
    if settings.profile == "paper":
        return *_PAPER_GRID, max(1, frames // 2)
    low, high = TRIPLANE.cells
    cell = max(size) / min(high, max(low, max(size) / TRIPLANE.cell_px))
    gx, gy = (min(high, max(low, round(side / cell))) for side in size)
    return gx, gy, frames


def halved(grid: GridSize) -> GridSize:
    """A tri-plane of half as many cells a side in space."""
    gx, gy, gt = grid
    return -(-gx // 2), -(-gy // 2), gt


def grid_parameters(grid: GridSize, blending: Blending) -> int:
    """Stored numbers of a tri-plane."""
    gx, gy, gt = grid
    return triplane_channels(blending) * (gx * gy + gx * gt + gy * gt)


def allocate(chains: Sequence[Chain], size: tuple[int, int], settings: EncodeSettings) -> list[int]:
    """Gaussians of the GOPs of each chain, when no size and no quality is asked for.

    Stored numbers are shared by length: every frame has as many. A GOP has at least one Gaussian,
    and at most one for each two pixels of a frame. Only with `gaussians` may GOPs be predicted.

    Raises:
        UsageError: `params` does not even hold the tri-planes.
    """
    width, height = size
    most = most_gaussians(size)
    if settings.gaussians is not None:
        return [settings.gaussians] * len(chains)
    gops = [gop for chain in chains for gop in chain]
    frames = sum(map(len, gops))
    total = settings.params or round(DEFAULT_DENSITY * width * height * frames)
    grids = [triplane_grid(size, len(gop), settings) for gop in gops]
    planes = [grid_parameters(grid, settings.blending) for grid in grids]
    each = gaussian_parameters(settings.blending)
    left = total - sum(planes)
    if settings.params is None:
        # The tri-planes of a small picture may take more than their share: half is for Gaussians.
        left = max(left, total // 2, each * len(gops))
    elif left < each * len(gops):
        raise UsageError(
            f"{total} parameters are too few: {len(gops)} GOPs need {sum(planes)} for their "
            f"deformation fields and {each} for each Gaussian; "
            "raise `params` or use longer GOPs"
        )
    spare = left // each - len(gops)
    lengths = [sum(map(len, chain)) for chain in chains]
    return [min(most, 1 + int(spare * length / frames)) for length in lengths]


def plan(
    chains: Sequence[Chain],
    stats: Sequence[FrameStats],
    size: tuple[int, int],
    settings: EncodeSettings,
    *,
    seconds: float,
) -> list[Budget]:
    """Budgets of all GOPs of a section; none depends on the result of another's fit.

    Args:
        chains: Frames of each GOP, one after another.
        stats: Statistics of every frame of the film up to the end of the section.
        size: Width and height, pixels.
        settings: Of the encode; a size or a PSNR is met by a constant quality.
        seconds: Duration of the section.

    Raises:
        UsageError: The parameters asked for are too few for this video.
    """
    target = settings.target
    assert not isinstance(target, Aim)
    if isinstance(target, Numbers):
        counts = allocate(chains, size, settings)
        return [Budget(n) for n, chain in zip(counts, chains, strict=True) for _ in chain]
    section = stats[chains[0][0].start : chains[-1][-1].stop]
    psnr = target.psnr(section, size, seconds)
    budgets = []
    for chain in chains:
        weights = bit_weights(chain, stats, psnr)
        own_stats = stats[chain[0].start : chain[-1].stop]
        whole = len(own_stats) * size[0] * size[1] * target.bpp(own_stats, size, seconds)
        least = min(8.0 * RATE.least_gop_bytes, whole / len(chain))
        of_key = least + (whole - least * len(chain)) / sum(weights)  # bits
        most = most_gaussians(size)
        fitted = round(min(most, _most_gaussians(chain, weights, settings)))
        gaussians = max(1, min(round(of_key / _gaussian_bits(chain)), fitted))
        expected = math.ceil(target.taken * gaussians)
        for number, gop in enumerate(chain):
            grid = _grid(len(gop), expected, size, settings, predicted=number > 0)
            cost = 1.0
            if number:
                changing = min(1.0, weights[number])
                cost = CHAIN.idle_step + (1 - CHAIN.idle_step) * changing
            lasts = 1.0 if number else lasting(chain, stats, psnr)
            budgets.append(Budget(gaussians, target.of_gop(most, lasts), grid, cost))
    return budgets


def _most_gaussians(chain: Chain, weights: Sequence[float], settings: EncodeSettings) -> float:
    """Most Gaussians in each GOP of a chain that the wall time of an encode suffices for."""
    if settings.time_budget is None:
        return math.inf
    gops, changing = (chain[1:], fmean(weights[1:])) if len(chain) > 1 else (chain, 1.0)
    return fittable(settings.time_budget * fmean(map(len, gops)), settings.execution) / changing


def _gaussian_bits(chain: Chain) -> float:
    """Bits of the payload of a key GOP for each Gaussian, at the best trade."""
    return RATE.gaussian_bits if len(chain) == 1 else CHAIN.gaussian_bits


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
    return affordable(halved(usual) if predicted else usual, gaussians, settings.blending)
