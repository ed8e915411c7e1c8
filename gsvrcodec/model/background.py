"""Backgrounds: Gaussians that stand still and belong to several GOPs (spec section 5.5)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.errors import CorruptError
from gsvrcodec.model.attributes import ATTRIBUTES
from gsvrcodec.model.gop import TRIPLANE_CHANNELS, Float32Array, Gop

#: Stored numbers of one Gaussian of a background: position 2, scale 2, rotation, colour 3.
BACKGROUND_PARAMETERS = 8

_OF_GAUSSIANS = tuple(a.name for a in ATTRIBUTES if a.grid == "gaussians")


@dataclass(frozen=True, slots=True, eq=False)
class Background:
    """What GOPs may share."""

    number: int  #: by which GOPs name it, from 1
    gop: Gop  #: its Gaussians as a GOP that stands still, in stored order; no tri-plane


def still_gop(
    position: Float32Array,
    log_scale: Float32Array,
    rotation: Float32Array,
    colour: Float32Array,
) -> Gop:
    """Return Gaussians at rest, without a tri-plane."""
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


def only(gop: Gop, shown: NDArray[np.bool_]) -> Gop:
    """Return some of the Gaussians of a GOP."""
    return replace(gop, **{name: getattr(gop, name)[shown] for name in _OF_GAUSSIANS})


def together(gop: Gop, still: Gop) -> Gop:
    """Return a GOP with Gaussians at rest added behind its own."""
    both = {
        name: np.concatenate([getattr(gop, name), getattr(still, name)]) for name in _OF_GAUSSIANS
    }
    return replace(gop, **both)


def with_background(gop: Gop, background: Background, shown: NDArray[np.bool_]) -> Gop:
    """Return a GOP with what it shows of its background.

    Raises:
        CorruptError: `shown` is not made for this background.
    """
    if len(shown) != len(background.gop):
        raise CorruptError(
            f"background {background.number} has {len(background.gop)} Gaussians, "
            f"the GOP expects {len(shown)}"
        )
    return together(gop, only(background.gop, shown))
