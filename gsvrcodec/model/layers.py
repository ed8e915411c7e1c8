"""Dynamic and static layers: the Gaussians of a GOP, split by their motion."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.model.gop import Float32Array, Gop
from gsvrcodec.model.static import select_gaussians

Layers = Literal["all", "dynamic", "static"]

#: Least displacement of a dynamic Gaussian against the median motion, in longer frame sides.
DYNAMIC_DISPLACEMENT = 1 / 160


def select_layers(gop: Gop, layers: Layers, coded_size: tuple[int, int]) -> Gop:
    """Return a GOP with the Gaussians of one layer, or of both.

    The median motion of a GOP's Gaussians, weighted by their areas, is taken for the motion of the
    camera. A Gaussian is dynamic if its polynomial takes it more than 1/160 of the frame's longer
    side away from the median motion. The dynamic indicator does not decide: fits leave it near its
    initial value for nearly all Gaussians. Where pictures are sums, those of the two layers add up
    to the whole picture, except where a sample is clamped at black or white. Where they are means,
    a layer shows the mean of its own Gaussians: what the other layer hides is seen.

    Args:
        gop: All Gaussians; the result shares the tri-plane.
        layers: "dynamic", "static" = all Gaussians that are not dynamic, or "all".
        coded_size: Width and height of the coded frame, pixels.
    """
    if layers == "all":
        return gop
    return select_gaussians(gop, dynamic(gop, coded_size) == (layers == "dynamic"))


def dynamic(gop: Gop, coded_size: tuple[int, int]) -> NDArray[np.bool_]:
    """Return whether each Gaussian is dynamic, shape (N,); see `select_layers`."""
    if not len(gop):
        return np.zeros(0, np.bool_)
    half = np.array(coded_size, np.float32) / 2
    areas = np.exp(gop.log_scale.sum(axis=1, dtype=np.float64))
    linear = (gop.linear - _median(gop.linear, areas)) * half
    quadratic = (gop.quadratic - _median(gop.quadratic, areas)) * half
    ends = [np.hypot(*(quadratic + way).T) for way in (linear, -linear)]
    return np.asarray(np.maximum(*ends) > DYNAMIC_DISPLACEMENT * max(coded_size))


def _median(values: Float32Array, weights: NDArray[np.float64]) -> Float32Array:
    """Return the weighted median of each column of (N, C), (C,): the least that half reaches."""
    order = np.argsort(values, axis=0, kind="stable")
    reached = np.cumsum(weights[order], axis=0)
    middle = (reached < reached[-1:] / 2).sum(axis=0)
    columns = np.arange(values.shape[1])
    return np.asarray(values[order[middle, columns], columns], np.float32)
