"""The attributes of a GOP by number: components, grid, bounds (spec section "Attributes")."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isqrt
from typing import Literal

from gsvrcodec.model.gop import TRIPLANE_CHANNELS

GridKind = Literal["gaussians", "xy", "xt", "yt", "background"]


@dataclass(frozen=True, slots=True)
class Attribute:
    """One field of a `Gop`; each component is coded as a plane."""

    id: int  #: number in the plane table
    name: str  #: field of `Gop`
    components: int  #: number of components, so of planes
    grid: GridKind  #: grid of the samples, which sets the size of the planes
    low: float  #: least allowed decoded value
    high: float  #: greatest allowed decoded value


#: In the order of the plane table. The bounds keep every float32 of the reconstruction finite.
ATTRIBUTES = (
    Attribute(0, "position", 2, "gaussians", -1024.0, 1024.0),
    Attribute(1, "log_scale", 2, "gaussians", -32.0, 13.0),
    Attribute(2, "rotation", 1, "gaussians", -64.0, 64.0),
    Attribute(3, "colour", 3, "gaussians", -65536.0, 65536.0),
    Attribute(4, "indicator", 1, "gaussians", -2.0, 2.0),
    Attribute(5, "linear", 2, "gaussians", -1024.0, 1024.0),
    Attribute(6, "quadratic", 2, "gaussians", -1024.0, 1024.0),
    Attribute(7, "xy", TRIPLANE_CHANNELS, "xy", -1024.0, 1024.0),
    Attribute(8, "xt", TRIPLANE_CHANNELS, "xt", -1024.0, 1024.0),
    Attribute(9, "yt", TRIPLANE_CHANNELS, "yt", -1024.0, 1024.0),
)
#: Mask of a GOP over the Gaussians of its background: 1 = shown, 0 = not.
SHOWN = Attribute(10, "shown", 1, "background", 0.0, 1.0)
#: Attributes of a background's Gaussians, which are static.
STATIC_ATTRIBUTES = ATTRIBUTES[:4]
ATTRIBUTE_BY_ID = {attribute.id: attribute for attribute in (*ATTRIBUTES, SHOWN)}


@dataclass(frozen=True, slots=True)
class GopShape:
    """Counts and grid sizes of a GOP or a background, from which all plane sizes follow."""

    gaussians: int  #: Gaussians N
    grid: tuple[int, int, int]  #: Gx, Gy, Gt; all 0 = no tri-plane
    background: int = 0  #: Gaussians of the background; 0 = none

    def plane_size(self, kind: GridKind) -> tuple[int, int]:
        """Width and height of the planes of one grid; (0, 0) = the grid has no planes.

        Gaussians fill a grid of ceil(sqrt(N)) columns, row by row.
        """
        if kind in ("gaussians", "background"):
            count = self.gaussians if kind == "gaussians" else self.background
            if not count:
                return 0, 0
            width = isqrt(count - 1) + 1
            return width, -(-count // width)
        gx, gy, gt = self.grid
        return {"xy": (gx, gy), "xt": (gx, gt), "yt": (gy, gt)}[kind]

    def samples(self, kind: GridKind) -> int:
        """Samples in a plane of one grid, without the padding of the last row."""
        if kind in ("gaussians", "background"):
            return self.gaussians if kind == "gaussians" else self.background
        width, height = self.plane_size(kind)
        return width * height

    def planes(
        self, attributes: Sequence[Attribute] = (*ATTRIBUTES, SHOWN)
    ) -> list[tuple[Attribute, int, int, int]]:
        """The planes of this shape in table order: attribute, component, width, height."""
        planes = []
        for attribute in attributes:
            width, height = self.plane_size(attribute.grid)
            if width:
                planes += [(attribute, part, width, height) for part in range(attribute.components)]
        return planes
