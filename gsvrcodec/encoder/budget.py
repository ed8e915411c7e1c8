"""Budget of one GOP: Gaussians, tri-plane, a size or a quality to meet."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from gsvrcodec.encoder.settings import EncodeSettings
from gsvrcodec.encoder.slicing import Chain
from gsvrcodec.encoder.tuned import CHAIN, TRIPLANE
from gsvrcodec.errors import UsageError
from gsvrcodec.fit.slope import Slope
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

    gaussians: int  #: N; with `target_psnr` or `slope` a first guess
    target_bytes: int | None = None  #: of the payload; None = not asked for
    target_psnr: float | None = None  #: dB, mean of the frames; None = not asked for
    slope: Slope | None = None  #: what a bit has to save; None = not asked for
    grid: GridSize | None = None  #: Gx, Gy, Gt of the tri-plane; None = the usual
    exact: bool = True  #: whether the bytes have to be met; else later GOPs make up for it
    step_cost: float = 1.0  #: time of an optimiser step, in that of the key GOP of the chain


def most_gaussians(size: tuple[int, int]) -> int:
    """One Gaussian for each two pixels of a frame."""
    return max(1, size[0] * size[1] // 2)


def fittable(seconds: float, settings: EncodeSettings) -> float:
    """Most Gaussians that a fit of so many seconds suffices for, on a CPU.

    With more of them a predicted GOP takes too few steps, and looks worse at more bits.
    """
    if choose_device(settings.device) != "cpu":
        return math.inf
    return seconds * resolve_threads(settings.threads) * CHAIN.fitted_a_second


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


def key_gaussians(size: int, grid: GridSize) -> int:
    """Gaussians of a key GOP in a chain for a payload of `size` bytes.

    Its tri-plane takes a part of the bytes, but half of them are for Gaussians.
    """
    bits = max(8 * size - CHAIN.number_bits * grid_parameters(grid, "mean"), 4 * size)
    return round(bits / CHAIN.gaussian_bits)


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
