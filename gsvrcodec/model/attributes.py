"""The attributes of a GOP by number: components, grid, bounds (spec section "Attributes")."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from math import isqrt
from typing import Literal

from gsvrcodec.model.reconstruction import MOST_LOG_OPACITY, Blending

#: Channels of a tri-plane: dx, dy, dsx, dsy, dtheta, and dr, dg, db where pictures are sums (spec
#: section "Deformation").
TRIPLANE_CHANNELS = 8
#: Of these where pictures are means: dx, dy, dsx, dsy, dtheta, and that of the log-opacity.
MEAN_CHANNELS = 6

GridKind = Literal["gaussians", "xy", "xt", "yt", "reference", "changed", "moved"]


@dataclass(frozen=True, slots=True)
class Attribute:
    """One field of a `Gop`; each component is coded as a plane."""

    id: int  #: its number: planes stand in ascending order of numbers
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
    Attribute(4, "log_opacity", 1, "gaussians", -MOST_LOG_OPACITY, MOST_LOG_OPACITY),
    Attribute(5, "indicator", 1, "gaussians", -2.0, 2.0),
    Attribute(6, "linear", 2, "gaussians", -1024.0, 1024.0),
    Attribute(7, "quadratic", 2, "gaussians", -1024.0, 1024.0),
    Attribute(8, "xy", TRIPLANE_CHANNELS, "xy", -1024.0, 1024.0),
    Attribute(9, "xt", TRIPLANE_CHANNELS, "xt", -1024.0, 1024.0),
    Attribute(10, "yt", TRIPLANE_CHANNELS, "yt", -1024.0, 1024.0),
)
#: How each Gaussian of the reference goes on; see `gsvrcodec.model.prediction`.
MODE = Attribute(11, "mode", 1, "reference", 0.0, 7.0)
#: What a predicted GOP stores of the Gaussians that it carries over.
CARRIED_ATTRIBUTES = (
    MODE,
    # Changes are stored in units of the Gaussian: `prediction.change_units`.
    Attribute(12, "position_change", 2, "changed", -1024.0, 1024.0, "position"),
    Attribute(13, "log_scale_change", 2, "changed", -45.0, 45.0, "log_scale"),
    Attribute(14, "rotation_change", 1, "changed", -64.0, 64.0, "rotation"),
    Attribute(15, "colour_change", 3, "changed", -65536.0, 65536.0, "colour"),
    Attribute(16, "log_opacity_change", 1, "changed", -24.0, 24.0, "log_opacity"),
    Attribute(17, "carried_indicator", 1, "moved", -2.0, 2.0, "indicator"),
    Attribute(18, "carried_linear", 2, "moved", -1024.0, 1024.0, "linear"),
    Attribute(19, "carried_quadratic", 2, "moved", -1024.0, 1024.0, "quadratic"),
)
#: Every attribute, in the order of the plane table.
ALL_ATTRIBUTES = (*ATTRIBUTES, *CARRIED_ATTRIBUTES)


@cache
def attributes_of(blending: Blending) -> tuple[Attribute, ...]:
    """Return the attributes of GOPs whose pictures are formed so, in the order of the plane table.

    Sums have no opacities; the tri-planes of means have fewer channels.
    """
    if blending == "sum":
        opacities = ("log_opacity", "log_opacity_change")
        return tuple(a for a in ALL_ATTRIBUTES if a.name not in opacities)
    return tuple(
        replace(a, components=MEAN_CHANNELS) if a.components == TRIPLANE_CHANNELS else a
        for a in ALL_ATTRIBUTES
    )


def gaussian_parameters(blending: Blending) -> int:
    """Numbers that are stored of a new Gaussian."""
    return sum(a.components for a in attributes_of(blending) if a.grid == "gaussians")


def triplane_channels(blending: Blending) -> int:
    """Numbers that are stored of each cell of a tri-plane."""
    return TRIPLANE_CHANNELS if blending == "sum" else MEAN_CHANNELS


@dataclass(frozen=True, slots=True)
class GopShape:
    """Counts and grid sizes of a GOP, from which all plane sizes follow."""

    gaussians: int  #: new Gaussians; in a key GOP all of them
    grid: tuple[int, int, int]  #: Gx, Gy, Gt; all 0 = no tri-plane
    reference: int = 0  #: Gaussians M of the reference; 0 = key GOP, or an empty reference
    changed: int = 0  #: of these, Gaussians C whose look changes
    moved: int = 0  #: of these, Gaussians V that move
    blending: Blending = "mean"  #: how pictures are formed, which sets the attributes

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
        every = attributes_of(self.blending)
        return [attribute for attribute in every if self.samples(attribute.grid)]

    def planes(self) -> list[tuple[Attribute, int, int, int]]:
        """Return the planes in table order: attribute, component, width, height."""
        return [
            (attribute, part, *size)
            for attribute in self.attributes()
            for size in [self.plane_size(attribute.grid)]
            for part in range(attribute.components)
        ]
