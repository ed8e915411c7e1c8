"""A GOP: canonical 2D Gaussians and the deformation field that moves them."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.model.attributes import TRIPLANE_CHANNELS as TRIPLANE_CHANNELS
from gsvrcodec.native import _core

Float32Array = NDArray[np.float32]

GridSize = tuple[int, int, int]  #: Gx, Gy, Gt of a tri-plane; all 0 = no tri-plane

#: Parameters of one Gaussian: position 2, scale 2, rotation, colour 3, opacity, indicator,
#: motion 4. Where pictures are sums it has no opacity.
GAUSSIAN_PARAMETERS = 14


@dataclass(frozen=True, slots=True, eq=False)
class Gop:
    """Decoder-side parameters of one GOP, all float32 and C-contiguous.

    N Gaussians; the tri-plane grids have Gx by Gy cells in space and Gt in time.
    """

    position: Float32Array  #: (N, 2) canonical centre x, y; the frame spans [-1, 1]
    log_scale: Float32Array  #: (N, 2) natural logarithm of sigma in pixels of the coded frame
    rotation: Float32Array  #: (N,) radians, counter-clockwise with y down, modulo pi
    colour: Float32Array  #: (N, 3) red, green, blue; any sign
    #: (N,) natural logarithm of the opacity; has no effect where pictures are sums
    log_opacity: Float32Array
    indicator: Float32Array  #: (N,) dynamic indicator in [0, 1]; 1 = the tri-plane has no effect
    linear: Float32Array  #: (N, 2) indicator * a1, coefficient of tau
    quadratic: Float32Array  #: (N, 2) indicator * a2, coefficient of tau^2
    xy: Float32Array  #: (Gy, Gx, 8) spatial grid
    xt: Float32Array  #: (Gt, Gx, 8) grid over x and time
    yt: Float32Array  #: (Gt, Gy, 8) grid over y and time

    def __len__(self) -> int:
        """Number of Gaussians N."""
        return len(self.position)

    @property
    def parameters(self) -> int:
        """Number of parameters, before quantisation."""
        return sum(getattr(self, field.name).size for field in fields(self))


def grid_size(gop: Gop) -> GridSize:
    """Gx, Gy and Gt of the tri-plane; all 0 = no tri-plane."""
    gy, gx, _ = gop.xy.shape
    return gx, gy, gop.xt.shape[0]


def parameters_of(gop: Gop) -> _core.Parameters:
    """The core's view of a GOP, or of its gradients: no copy, shapes checked."""
    return _core.Parameters(*(getattr(gop, field.name) for field in fields(Gop)))
