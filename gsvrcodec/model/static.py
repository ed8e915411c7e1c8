"""Static Gaussians: their GOP, and Gaussians chosen from and joined to a GOP."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.model.attributes import ATTRIBUTES
from gsvrcodec.model.gop import TRIPLANE_CHANNELS, Float32Array, Gop

#: Names of what each Gaussian has; the rest of a GOP is its tri-plane.
GAUSSIAN_ATTRIBUTES = tuple(a.name for a in ATTRIBUTES if a.grid == "gaussians")


def static_gop(
    position: Float32Array,
    log_scale: Float32Array,
    rotation: Float32Array,
    colour: Float32Array,
    log_opacity: Float32Array,
) -> Gop:
    """Return a GOP of static Gaussians: indicator 1, no motion, no tri-plane.

    Args:
        position: Shape (N, 2), canonical centres x, y.
        log_scale: Shape (N, 2), natural logarithms of sigma in pixels of the coded frame.
        rotation: Shape (N,), radians.
        colour: Shape (N, 3), red, green and blue.
        log_opacity: Shape (N,), natural logarithms of the opacities.
    """
    count = len(position)
    none = np.zeros((0, 0, TRIPLANE_CHANNELS), np.float32)
    return Gop(
        position=np.ascontiguousarray(position),
        log_scale=np.ascontiguousarray(log_scale),
        rotation=np.ascontiguousarray(rotation),
        colour=np.ascontiguousarray(colour),
        log_opacity=np.ascontiguousarray(log_opacity),
        indicator=np.ones(count, np.float32),
        linear=np.zeros((count, 2), np.float32),
        quadratic=np.zeros((count, 2), np.float32),
        xy=none,
        xt=none,
        yt=none,
    )


def select_gaussians(gop: Gop, chosen: NDArray[np.bool_] | NDArray[np.intp]) -> Gop:
    """Return a GOP with chosen Gaussians, by a mask or by numbers; the tri-plane is shared."""
    numbers = np.flatnonzero(chosen) if chosen.dtype == np.bool_ else chosen
    return replace(
        gop, **{name: np.take(getattr(gop, name), numbers, 0) for name in GAUSSIAN_ATTRIBUTES}
    )


def resized(gop: Gop, count: int) -> Gop:
    """Return a GOP of `count` Gaussians whose values are not set; the tri-plane is `gop`'s."""
    every = {name: getattr(gop, name) for name in GAUSSIAN_ATTRIBUTES}
    return replace(
        gop, **{name: np.empty((count, *own.shape[1:]), np.float32) for name, own in every.items()}
    )


def append_gaussians(gop: Gop, static: Gop) -> Gop:
    """Return `gop` with the Gaussians of a static GOP behind its own; the tri-plane is `gop`'s."""
    both = {
        name: np.concatenate([getattr(gop, name), getattr(static, name)])
        for name in GAUSSIAN_ATTRIBUTES
    }
    return replace(gop, **both)
