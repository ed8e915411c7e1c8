"""Backgrounds: static Gaussians that several GOPs share (spec section 5.5)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.errors import CorruptError
from gsvrcodec.model.attributes import ATTRIBUTES
from gsvrcodec.model.gop import TRIPLANE_CHANNELS, Float32Array, Gop

#: Stored numbers of one Gaussian of a background: position 2, scale 2, rotation, colour 3.
BACKGROUND_PARAMETERS = 8

_GAUSSIAN_ATTRIBUTES = tuple(a.name for a in ATTRIBUTES if a.grid == "gaussians")


@dataclass(frozen=True, slots=True, eq=False)
class Background:
    """Static Gaussians that several GOPs may show."""

    number: int  #: number by which GOPs refer to the background, from 1
    gop: Gop  #: the Gaussians in stored order, as a GOP without motion and without a tri-plane


def static_gop(
    position: Float32Array,
    log_scale: Float32Array,
    rotation: Float32Array,
    colour: Float32Array,
) -> Gop:
    """Return a GOP of static Gaussians: indicator 1, no motion, no tri-plane.

    Args:
        position: Shape (N, 2), canonical centres x, y.
        log_scale: Shape (N, 2), natural logarithms of sigma in pixels of the coded frame.
        rotation: Shape (N,), radians.
        colour: Shape (N, 3), red, green and blue weights.
    """
    count = len(position)
    none = np.zeros((0, 0, TRIPLANE_CHANNELS), np.float32)
    return Gop(
        position=np.ascontiguousarray(position),
        log_scale=np.ascontiguousarray(log_scale),
        rotation=np.ascontiguousarray(rotation),
        colour=np.ascontiguousarray(colour),
        indicator=np.ones(count, np.float32),
        linear=np.zeros((count, 2), np.float32),
        quadratic=np.zeros((count, 2), np.float32),
        xy=none,
        xt=none,
        yt=none,
    )


def select_gaussians(gop: Gop, mask: NDArray[np.bool_]) -> Gop:
    """Return a GOP with the Gaussians that `mask`, shape (N,), selects; the tri-plane is shared."""
    return replace(gop, **{name: getattr(gop, name)[mask] for name in _GAUSSIAN_ATTRIBUTES})


def append_gaussians(gop: Gop, static: Gop) -> Gop:
    """Return `gop` with the Gaussians of a static GOP behind its own; the tri-plane is `gop`'s."""
    both = {
        name: np.concatenate([getattr(gop, name), getattr(static, name)])
        for name in _GAUSSIAN_ATTRIBUTES
    }
    return replace(gop, **both)


def check_shown(background: Background, shown: NDArray[np.bool_]) -> None:
    """Check that the mask `shown` of a GOP has one value for each Gaussian of its background.

    Raises:
        CorruptError: The background has another number of Gaussians than `shown`.
    """
    if len(shown) != len(background.gop):
        raise CorruptError(
            f"background {background.number} has {len(background.gop)} Gaussians, "
            f"the GOP expects {len(shown)}"
        )


def append_background(gop: Gop, background: Background, shown: NDArray[np.bool_]) -> Gop:
    """Return a GOP with the Gaussians of its background that it shows behind its own.

    Args:
        gop: The GOP.
        background: The background that the GOP refers to.
        shown: Shape (Gaussians of the background,), which of them the GOP shows.

    Raises:
        CorruptError: The background has another number of Gaussians than `shown`.
    """
    check_shown(background, shown)
    return append_gaussians(gop, select_gaussians(background.gop, shown))
