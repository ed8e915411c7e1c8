"""What moves by itself and what does not: the Gaussians of a GOP, split by their motion."""

from __future__ import annotations

from dataclasses import fields
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.model.gop import Gop

Layers = Literal["all", "dynamic", "static"]

#: How far a Gaussian strays from the common motion to be dynamic, part of the frame's longer side.
DYNAMIC_WAY = 1 / 160


def select_layers(gop: Gop, layers: Layers, coded_size: tuple[int, int]) -> Gop:
    """Return a GOP with the Gaussians of some layers alone.

    The dynamic indicator indicator is part of the polynomial that a GOP stores, so what counts is
    where that takes a Gaussian: a dynamic one strays from the median motion, which is that of the
    camera, by more than 1/160 of the longer side. (indicator alone tells little: fits leave it near
    its start for nearly all Gaussians.) A picture is a sum over Gaussians, so the pictures of the
    two layers add up to the whole one, but for the clamping of each at black and white.

    Args:
        gop: the whole GOP; it shares its tri-plane with the result.
        layers: "dynamic", "static" = the others, or "all".
        coded_size: width and height of the coded frame, pixels.
    """
    if layers == "all":
        return gop
    chosen = _dynamic(gop, coded_size) == (layers == "dynamic")
    grids = {"xy", "xt", "yt"}
    values = {field.name: getattr(gop, field.name) for field in fields(Gop)}
    return Gop(**{name: v if name in grids else v[chosen] for name, v in values.items()})


def _dynamic(gop: Gop, coded_size: tuple[int, int]) -> NDArray[np.bool_]:
    """Which Gaussians are dynamic, (N,)."""
    if not len(gop):
        return np.zeros(0, np.bool_)
    half = np.array(coded_size, np.float32) / 2
    linear = (gop.linear - np.median(gop.linear, axis=0)) * half
    quadratic = (gop.quadratic - np.median(gop.quadratic, axis=0)) * half
    ends = [np.hypot(*(quadratic + way).T) for way in (linear, -linear)]
    return np.asarray(np.maximum(*ends) > DYNAMIC_WAY * max(coded_size))
