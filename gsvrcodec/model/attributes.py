"""The attributes of a GOP by number: components, grid, bounds (spec section "Attributes")."""

from __future__ import annotations

from dataclasses import dataclass
from math import isqrt
from typing import Literal

#: Channels of a tri-plane: dx, dy, dsx, dsy, dtheta, dr, dg, db (spec section "Deformation").
TRIPLANE_CHANNELS = 8

GridKind = Literal["gaussians", "xy", "xt", "yt", "reference", "changed", "moved"]


@dataclass(frozen=True, slots=True)
class Attribute:
    """One field of a `Gop`; each component is coded as a plane."""

    id: int  #: number in the plane table
    name: str  #: field of `Gop`
    components: int  #: number of components, so of planes
    grid: GridKind  #: grid of the samples, which sets the size of the planes
    low: float  #: least allowed decoded value
    high: float  #: greatest allowed decoded value
    change_of: str = ""  #: attribute whose change this is, and whose steps it has; "" = none


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
#: How each Gaussian of the reference goes on; see `gsvrcodec.model.prediction`.
MODE = Attribute(10, "mode", 1, "reference", 0.0, 7.0)
#: What a predicted GOP stores of the Gaussians that it carries over.
CARRIED_ATTRIBUTES = (
    MODE,
    Attribute(11, "position_change", 2, "changed", -1024.0, 1024.0, "position"),
    Attribute(12, "log_scale_change", 2, "changed", -45.0, 45.0, "log_scale"),
    Attribute(13, "rotation_change", 1, "changed", -64.0, 64.0, "rotation"),
    Attribute(14, "colour_change", 3, "changed", -65536.0, 65536.0, "colour"),
    Attribute(15, "carried_indicator", 1, "moved", -2.0, 2.0, "indicator"),
    Attribute(16, "carried_linear", 2, "moved", -1024.0, 1024.0, "linear"),
    Attribute(17, "carried_quadratic", 2, "moved", -1024.0, 1024.0, "quadratic"),
)
#: Every attribute, in the order of the plane table.
ALL_ATTRIBUTES = (*ATTRIBUTES, *CARRIED_ATTRIBUTES)
ATTRIBUTE_BY_ID = {attribute.id: attribute for attribute in ALL_ATTRIBUTES}


@dataclass(frozen=True, slots=True)
class GopShape:
    """Counts and grid sizes of a GOP, from which all plane sizes follow."""

    gaussians: int  #: new Gaussians; in a key GOP all of them
    grid: tuple[int, int, int]  #: Gx, Gy, Gt; all 0 = no tri-plane
    reference: int = 0  #: Gaussians M of the reference; 0 = key GOP, or an empty reference
    changed: int = 0  #: of these, Gaussians C whose look changes
    moved: int = 0  #: of these, Gaussians V that move

    def plane_size(self, kind: GridKind) -> tuple[int, int]:
        """Return width and height of the planes of one grid; (0, 0) = the grid has no planes.

        Lists of Gaussians fill a grid of ceil(sqrt(count)) columns, row by row.
        """
        if kind in ("xy", "xt", "yt"):
            gx, gy, gt = self.grid
            return {"xy": (gx, gy), "xt": (gx, gt), "yt": (gy, gt)}[kind]
        count = self.samples(kind)
        if not count:
            return 0, 0
        width = isqrt(count - 1) + 1
        return width, -(-count // width)

    def samples(self, kind: GridKind) -> int:
        """Return the samples in a plane of one grid, without the padding of the last row."""
        if kind in ("xy", "xt", "yt"):
            width, height = self.plane_size(kind)
            return width * height
        count: int = getattr(self, kind)
        return count

    def attributes(self) -> list[Attribute]:
        """Return the attributes that have samples, in table order."""
        return [attribute for attribute in ALL_ATTRIBUTES if self.samples(attribute.grid)]

    def planes(self) -> list[tuple[Attribute, int, int, int]]:
        """Return the planes in table order: attribute, component, width, height."""
        return [
            (attribute, part, *size)
            for attribute in self.attributes()
            for size in [self.plane_size(attribute.grid)]
            for part in range(attribute.components)
        ]
