"""The attributes of a GOP by number: components, grid, bounds (spec section "Attributes")."""

from __future__ import annotations

from dataclasses import dataclass
from math import isqrt
from typing import Literal

from gsvrcodec.model.gop import TRIPLANE_CHANNELS

Grid = Literal["gaussians", "xy", "xt", "yt"]


@dataclass(frozen=True, slots=True)
class Attribute:
    """One field of a `Gop`; each of its components is a plane of its own."""

    id: int  #: number in the plane table
    name: str  #: field of `Gop`
    components: int  #: planes of it
    grid: Grid  #: what its samples stand for
    low: float  #: no decoded value is smaller
    high: float  #: no decoded value is larger


#: In the order of the plane table. The bounds keep every float32 of the reconstruction finite.
ATTRIBUTES = (
    Attribute(0, "position", 2, "gaussians", -1024.0, 1024.0),
    Attribute(1, "log_scale", 2, "gaussians", -32.0, 13.0),
    Attribute(2, "rotation", 1, "gaussians", -64.0, 64.0),
    Attribute(3, "colour", 3, "gaussians", -65536.0, 65536.0),
    Attribute(4, "alpha", 1, "gaussians", -2.0, 2.0),
    Attribute(5, "linear", 2, "gaussians", -1024.0, 1024.0),
    Attribute(6, "quadratic", 2, "gaussians", -1024.0, 1024.0),
    Attribute(7, "xy", TRIPLANE_CHANNELS, "xy", -1024.0, 1024.0),
    Attribute(8, "xt", TRIPLANE_CHANNELS, "xt", -1024.0, 1024.0),
    Attribute(9, "yt", TRIPLANE_CHANNELS, "yt", -1024.0, 1024.0),
)
ATTRIBUTE_BY_ID = {attribute.id: attribute for attribute in ATTRIBUTES}


def plane_size(kind: Grid, gaussians: int, grid: tuple[int, int, int]) -> tuple[int, int]:
    """Width and height of the planes of one grid; (0, 0) = the GOP has no such planes.

    Args:
        kind: Which grid.
        gaussians: N; they fill a grid of ceil(sqrt(N)) columns row by row.
        grid: Gx, Gy, Gt.
    """
    if kind == "gaussians":
        if not gaussians:
            return 0, 0
        width = isqrt(gaussians - 1) + 1
        return width, -(-gaussians // width)
    gx, gy, gt = grid
    return {"xy": (gx, gy), "xt": (gx, gt), "yt": (gy, gt)}[kind]


def expected_planes(
    gaussians: int, grid: tuple[int, int, int]
) -> list[tuple[Attribute, int, int, int]]:
    """The planes a GOP must have, in order: attribute, component, width, height."""
    planes = []
    for attribute in ATTRIBUTES:
        width, height = plane_size(attribute.grid, gaussians, grid)
        if width:
            planes += [(attribute, part, width, height) for part in range(attribute.components)]
    return planes
