"""How many parameters each GOP gets."""

from __future__ import annotations

from collections.abc import Sequence

from gsvrcodec.errors import UsageError
from gsvrcodec.fit.settings import EncodeSettings
from gsvrcodec.model.gop import TRIPLANE_CHANNELS

Grid = tuple[int, int, int]

#: Stored numbers of one Gaussian: position 2, scale 2, rotation, colour 3, alpha, motion 4.
GAUSSIAN_PARAMETERS = 13
#: Stored numbers a pixel and frame when nothing is asked for: the paper's 3M for its clip.
DEFAULT_DENSITY = 3e6 / (132 * 1280 * 640)
_CELL_PX = 20.0
_GRID_RANGE = (4, 64)
_PAPER_GRID = (32, 16)


def triplane_grid(size: tuple[int, int], frames: int, settings: EncodeSettings) -> Grid:
    """Gx, Gy, Gt of a GOP of `frames` frames of `size` (width, height); zeros for no tri-plane."""
    if settings.deform == "polynomial":
        return 0, 0, 0
    if settings.profile == "paper":
        return *_PAPER_GRID, max(1, frames // 2)
    low, high = _GRID_RANGE
    cells = max(size) / min(high, max(low, max(size) / _CELL_PX))
    gx, gy = (min(high, max(low, round(side / cells))) for side in size)
    return gx, gy, frames


def grid_parameters(grid: Grid) -> int:
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
    most = max(1, width * height // 2)
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
