"""Steps of Adam: along the axes of Gaussians, at a pace of each."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from gsvrcodec.fit.parameters import GRIDS, MOTION, Parameters, Tensors
from gsvrcodec.fit.recipe import Recipe
from gsvrcodec.render.backend import Backend, Scalar

#: Attributes whose first two components are lengths along x and y.
_LENGTHS = frozenset(("linear", "quadratic", "xy"))


class Axes:
    """The axes of N Gaussians, as long as their scales in the mean scale of all.

    Args:
        tensors: the decoder's parameters, by the names of `Gop`.
        size: width and height of the coded frame, pixels.
    """

    #: Shortest and longest axis, in the mean scale. 0.1 and 10 cost 0.01 dB.
    _RANGE = (0.3, 3.0)

    def __init__(self, tensors: Mapping[str, Tensor], size: tuple[int, int]) -> None:
        log_scale, rotation = tensors["log_scale"], tensors["rotation"]
        self._lengths = torch.empty_like(log_scale)
        # Rotations as complex numbers: as fast as one multiplication of arrays.
        self._turn = torch.empty_like(rotation, dtype=torch.complex64)
        pixel = torch.tensor([2 / size[0], 2 / size[1]], device=log_scale.device)
        self._pixel = pixel.repeat(len(log_scale), 1)
        self.look(tensors)

    def look(self, tensors: Mapping[str, Tensor]) -> None:
        """Follow the tensors, which are of the same Gaussians, in place."""
        log_scale, rotation = tensors["log_scale"], tensors["rotation"]
        lengths = torch.exp(log_scale - log_scale.mean())
        torch.clamp(lengths, *self._RANGE, out=self._lengths)
        torch.polar(torch.ones_like(rotation), rotation, out=self._turn)

    def gradient(self, gradient: Tensor) -> Tensor:
        """Return the gradient by steps along the axes, from that by positions; (N, 2) both."""
        pixels = torch.view_as_complex(gradient * self._pixel)
        return torch.view_as_real(pixels * self._turn.conj()) * self._lengths

    def offset(self, steps: Tensor) -> Tensor:
        """Return the offsets of positions, halves of the frame, of steps along the axes."""
        along = torch.view_as_complex(steps * self._lengths)
        return torch.view_as_real(along * self._turn) * self._pixel


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
            found[name] = new if parameters.raw[name].dim() > 1 else new[:, 0]
    if recipe.fast and "linear" in parameters.raw:
        linear = parameters.raw["linear"]
        way = torch.hypot(linear[:, :1] * (size[0] / 2), linear[:, 1:] * (size[1] / 2))
        factor = 1 + recipe.fast * way / (way + recipe.fast_px)
        for name in MOTION:
            found[name] = factor * found[name] if name in found else factor
    return found


class Adam:
    """Adam with a rate for each component of an attribute; positions move along their axes.

    Args:
        raw: what is optimised, by the names of `Gop`.
        recipe: rates and betas.
        size: width and height of the coded frame, pixels.
        backend: takes the steps.
    """

    _EPSILON = 1e-15

    def __init__(
        self, raw: Tensors, recipe: Recipe, size: tuple[int, int], backend: Backend
    ) -> None:
        self._raw, self._betas, self._backend = raw, recipe.betas, backend
        self._size, self._along_axes = size, recipe.in_pixels
        self._axes: Axes | None = None
        self._mean = {name: torch.zeros_like(tensor) for name, tensor in raw.items()}
        self._square = {name: torch.zeros_like(tensor) for name, tensor in raw.items()}
        self._rates = {}
        for name, tensor in raw.items():
            components = tensor.shape[-1] if tensor.dim() > 1 else 1
            rates = np.full(components, recipe.rates[name], np.float32)
            if recipe.in_pixels and name in _LENGTHS:
                rates[:2] /= np.array(size, np.float32) / 2
            self._rates[name] = torch.from_numpy(rates).to(tensor.device)

    def look(self, tensors: Tensors) -> None:
        """Look at the axes that positions move along: before the first step, and now and then.

        Args:
            tensors: the decoder's parameters, by the names of `Gop`.
        """
        if not self._along_axes:
            return
        if self._axes is None:
            self._axes = Axes(tensors, self._size)
        else:
            self._axes.look(tensors)

    def step(
        self, gradients: Tensors, factor: Scalar, number: Scalar, paces: Tensors | None = None
    ) -> None:
        """Follow the gradients.

        Args:
            gradients: of all of `raw`.
            factor: of all rates.
            number: of this step, from 1.
            paces: factors of the rates of each Gaussian, by attribute; none = 1.
        """
        for name, raw in self._raw.items():
            gradient, value = gradients[name], raw
            axes = self._axes if name == "position" else None
            pace = None if paces is None else paces.get(name)
            if axes is not None:
                gradient = axes.gradient(gradient)
            if axes is not None or pace is not None:
                value = torch.zeros_like(raw)
            self._backend.adam_step(
                value,
                gradient,
                self._mean[name],
                self._square[name],
                self._rates[name],
                factor,
                self._betas,
                self._EPSILON,
                number,
            )
            if axes is not None:
                value = axes.offset(value)
            if value is not raw:
                raw.add_(value if pace is None else pace * value)

    def rearrange(self, order: NDArray[np.intp], moved: NDArray[np.bool_] | None = None) -> None:
        """Put the moments of all Gaussians into a new order; those that moved start anew."""
        self._axes = None
        for name in self._raw.keys() - {"xy", "xt", "yt"}:
            for moments in (self._mean, self._square):
                moments[name] = moments[name][order]
                if moved is not None:
                    moments[name][moved] = 0.0
