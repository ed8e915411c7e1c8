"""Steps of Adam: along the axes of Gaussians, at a pace of each."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.fit.parameters import GRIDS, MOTION, Parameters, Tensors
from gsvrcodec.fit.recipe import Recipe
from gsvrcodec.render.backend import AdamPart, AdamRule, Backend, Scalar, Tensor

#: Attributes whose first two components are lengths along x and y.
_LENGTHS = frozenset(("linear", "quadratic", "xy"))


#: Logarithms of the shortest and the longest axis, in the mean scale. 0.1 and 10 cost 0.01 dB.
_LOG_AXES = (math.log(0.3), math.log(3.0))


def axes_of(tensors: Mapping[str, Tensor], size: tuple[int, int], xp: Any) -> Tensor:
    """The axes of N Gaussians, as long as their scales in the mean scale of all.

    Args:
        tensors: the decoder's parameters, by the names of `Gop`.
        size: width and height of the coded frame, pixels.
        xp: library of the tensors, see `Backend`.

    Returns:
        (N, 2, 2): x and y of the first and of the second axis, which is the last index; the frame
        spans [-1, 1].
    """
    log_scale, rotation = tensors["log_scale"], tensors["rotation"]
    lengths = xp.exp(xp.clip(log_scale - log_scale.mean(), *_LOG_AXES))
    x, y = xp.cos(rotation), xp.sin(rotation)
    along_x, along_y = xp.stack([x, -y], 1), xp.stack([y, x], 1)
    halves = size[0] / 2, size[1] / 2
    return xp.stack([along_x * lengths / halves[0], along_y * lengths / halves[1]], 1)


def turns_of(tensors: Mapping[str, Tensor], xp: Any) -> Tensor:
    """The smaller scale of N Gaussians over the larger: what a turn changes grows with length.

    Args:
        tensors: the decoder's parameters, by the names of `Gop`.
        xp: library of the tensors, see `Backend`.

    Returns:
        (N,), of (0, 1].
    """
    log_scale = tensors["log_scale"]
    return xp.exp(-abs(log_scale[:, 0] - log_scale[:, 1]))


def paces(parameters: Parameters, recipe: Recipe, size: tuple[int, int]) -> Tensors:
    """Factors of the rates of each Gaussian.

    What is new in a predicted GOP has further to go than what is carried over. Fast motion is known
    less exactly than slow motion; what stands still has to stay where it is.

    Args:
        parameters: Parameters of the fit.
        recipe: Rates.
        size: Width and height of the coded frame, pixels.

    Returns:
        By the names of attributes: (N, 1), or (N,) where an attribute has one component.
    """
    found: Tensors = {}
    if parameters.carried is not None and recipe.new != 1:
        new = 1 + (recipe.new - 1) * (1 - parameters.carried)
        for name in parameters.raw.keys() - set(GRIDS):
            found[name] = new if parameters.raw[name].ndim > 1 else new[:, 0]
    if recipe.fast and "linear" in parameters.raw:
        linear = parameters.raw["linear"]
        way = parameters.backend.xp.hypot(
            linear[:, :1] * (size[0] / 2), linear[:, 1:] * (size[1] / 2)
        )
        factor = 1 + recipe.fast * way / (way + recipe.fast_px)
        for name in MOTION:
            found[name] = factor * found[name] if name in found else factor
    return found


class Adam:
    """Adam with a rate for each component of an attribute, in units of each Gaussian.

    Positions move along the axes, and slender Gaussians turn slowly, if the recipe is in pixels.

    A number of a Gaussian stays where it is while the gradient of the present frame opposes its
    momentum, if the recipe says so. The tri-plane takes all of its steps.

    Args:
        raw: what is optimised, by the names of `Gop`.
        recipe: rates and rule.
        size: width and height of the coded frame, pixels.
        backend: takes the steps.
    """

    def __init__(
        self, raw: Tensors, recipe: Recipe, size: tuple[int, int], backend: Backend
    ) -> None:
        self._raw, self._backend = raw, backend
        gaussians = [name for name in raw if name not in GRIDS]
        grids = [name for name in raw if name in GRIDS]
        self._ruled = (gaussians, recipe.rule), (grids, AdamRule(recipe.rule.betas))
        self._size, self._along_axes = size, recipe.in_pixels
        self._parts: dict[str, AdamPart] = {}
        for name, tensor in raw.items():
            components = tensor.shape[-1] if tensor.ndim > 1 else 1
            rates = np.full(components, recipe.rates[name], np.float32)
            if recipe.in_pixels and name in _LENGTHS:
                rates[:2] /= np.array(size, np.float32) / 2
            moments = backend.xp.zeros_like(tensor), backend.xp.zeros_like(tensor)
            self._parts[name] = AdamPart(tensor, *moments, backend.hold(rates))

    def look(self, tensors: Tensors, paces: Tensors | None = None) -> None:
        """Look at axes and paces of Gaussians: before the first step, and now and then.

        Args:
            tensors: the decoder's parameters, by the names of `Gop`.
            paces: as `paces` gives them; None = 1.
        """
        paces, xp = dict(paces or {}), self._backend.xp
        if self._along_axes and "position" in self._parts:
            self._put("position", "axes", axes_of(tensors, self._size, xp))
        if self._along_axes and "rotation" in self._parts:
            paces["rotation"] = turns_of(tensors, xp) * paces.get("rotation", 1.0)
        for name, pace in paces.items():
            self._put(name, "pace", pace * xp.ones_like(self._raw[name]))

    def step(self, gradients: Tensors, factor: Scalar, number: Scalar) -> None:
        """Follow the gradients.

        Args:
            gradients: of all of `raw`.
            factor: of all rates.
            number: of this step, from 1.
        """
        for names, rule in self._ruled:
            slopes = [gradients[name] for name in names]
            parts = [self._parts[name] for name in names]
            self._backend.adam_step(parts, slopes, rule, factor, number)

    def rearrange(self, order: NDArray[np.intp], moved: NDArray[np.bool_] | None = None) -> None:
        """Put the moments of all Gaussians into a new order; those that moved start anew."""
        for name, part in self._parts.items():
            if name in GRIDS:
                continue
            mean, square = part.mean[order], part.square[order]
            if moved is not None:
                mean[moved] = square[moved] = 0.0
            self._parts[name] = AdamPart(self._raw[name], mean, square, part.rates)

    def _put(self, name: str, what: Literal["axes", "pace"], values: Tensor) -> None:
        """Hold values of a part, in place where there are some already."""
        part = self._parts[name]
        before = getattr(part, what)
        if before is None:
            setattr(part, what, values)
            part.held = None
        else:
            before[...] = values
