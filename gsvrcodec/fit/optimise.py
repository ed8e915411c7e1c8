"""Gradient descent of one GOP: Adam, one frame a step, coarse to fine."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from statistics import fmean

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from gsvrcodec.fit.axes import Axes
from gsvrcodec.fit.effect import losses
from gsvrcodec.fit.field import Field, Tensors
from gsvrcodec.fit.footage import Footage, Frames, backdrop, some_frames
from gsvrcodec.fit.pace import paces
from gsvrcodec.fit.price import Price
from gsvrcodec.fit.recipe import Recipe
from gsvrcodec.fit.relocate import relocate, reorder
from gsvrcodec.fit.sensitivity import sensitivities
from gsvrcodec.fit.slope import Slope
from gsvrcodec.fit.tuned import RELOCATION
from gsvrcodec.metrics import squared_error
from gsvrcodec.render.backend import Backend, Samples

#: Attributes whose first two components are lengths along x and y.
_LENGTHS = frozenset(("linear", "quadratic", "xy"))
#: Steps after which the axes of Gaussians are looked at again.
_AXES_STEPS = 8


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
        self._steps = 0
        self._mean = {name: torch.zeros_like(tensor) for name, tensor in raw.items()}
        self._square = {name: torch.zeros_like(tensor) for name, tensor in raw.items()}
        self._rates = {}
        for name, tensor in raw.items():
            components = tensor.shape[-1] if tensor.dim() > 1 else 1
            rates = np.full(components, recipe.rates[name], np.float32)
            if recipe.in_pixels and name in _LENGTHS:
                rates[:2] /= np.array(size, np.float32) / 2
            self._rates[name] = torch.from_numpy(rates).to(tensor.device)

    def step(
        self, gradients: Tensors, factor: float, tensors: Tensors, paces: Tensors | None = None
    ) -> None:
        """Follow the gradients.

        Args:
            gradients: of all of `raw`.
            factor: of all rates.
            tensors: the decoder's parameters, by the names of `Gop`.
            paces: factors of the rates of each Gaussian, by attribute; none = 1.
        """
        self._steps += 1
        for name, raw in self._raw.items():
            gradient, value = gradients[name], raw
            axes = self._axes_of(tensors) if name == "position" else None
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
                self._steps,
            )
            if axes is not None:
                value = axes.offset(value)
            if value is not raw:
                raw.add_(value if pace is None else pace * value)

    def _axes_of(self, tensors: Tensors) -> Axes | None:
        """The axes that positions move along; None = the frame's."""
        if self._along_axes and (self._axes is None or self._steps % _AXES_STEPS == 0):
            self._axes = Axes(tensors, self._size)
        return self._axes

    def rearrange(self, order: NDArray[np.intp], moved: NDArray[np.bool_] | None = None) -> None:
        """Put the moments of all Gaussians into a new order; those that moved start anew."""
        self._axes = None
        for name in self._raw.keys() - {"xy", "xt", "yt"}:
            for moments in (self._mean, self._square):
                moments[name] = moments[name][order]
                if moved is not None:
                    moments[name][moved] = 0.0


#: Steps after which their pace is known.
_PACE_STEPS = 10


class Effort:
    """How much of a fit's effort is spent, in [0, 1]: by steps, or by wall time when given.

    Wall time runs from construction.
    """

    def __init__(self, steps: int, seconds: float | None = None) -> None:
        self._steps, self._seconds = steps, seconds
        self._start = time.perf_counter()
        self.steps = 0  #: taken so far

    def advance(self) -> None:
        """Count one step."""
        self.steps += 1

    @property
    def spent(self) -> float:
        """Fraction of the effort that is spent; 1 or more = it is used up."""
        if self._seconds is None:
            return self.steps / self._steps
        return (time.perf_counter() - self._start) / self._seconds

    @property
    def expected_steps(self) -> float:
        """Steps of the whole effort; with a wall time, extrapolated from the steps so far."""
        if self._seconds is None or self.steps < _PACE_STEPS:
            return self._steps
        return self.steps / self.spent


def visits(frames: int, rng: np.random.Generator) -> Iterator[int]:
    """Yield numbers of frames without end, each of them once in every round."""
    while True:
        yield from rng.permutation(frames).tolist()


def optimise(
    field: Field,
    footage: Footage,
    recipe: Recipe,
    effort: Effort,
    rng: np.random.Generator,
    *,
    price: Price | None = None,
    slope: Slope | None = None,
    quantise: Callable[[Tensors], Tensors] | None = None,
    quantise_from: float = 1.0,
) -> None:
    """Fit `field` to `footage`, in place.

    Args:
        field: the parameters.
        footage: frames to show.
        recipe: rates and schedule.
        effort: when to stop.
        rng: order of the frames, places of relocated Gaussians.
        slope: that the number of Gaussians follows; None = their number stays.
        price: of changes, from the end of the coarse stage on; None = they are free.
        quantise: fake quantisation of the decoder's parameters.
        quantise_from: fraction of the effort after which `quantise` is applied.
    """
    size, frames = footage.size, footage.frames
    small = coarse_frames(frames, recipe)
    shown = small
    targets, behind = targets_of(field, shown, size)
    reorder(field, size)
    adam = Adam(field.raw, recipe, size, field.backend)
    order = visits(len(frames), rng)
    relocations = iter(recipe.relocations)
    relocation = next(relocations, 1.0)
    settled = 0  # so many steps have to be taken before another one
    prunings = iter(recipe.prunings)
    pruning = next(prunings, 1.0)

    def rearranged(order: NDArray[np.intp], moved: NDArray[np.bool_] | None = None) -> None:
        adam.rearrange(order, moved)
        if price is not None:
            price.forget()

    while (spent := effort.spent) < 1.0:
        if spent >= relocation:
            relocation = next(relocations, 1.0)
            if effort.steps >= settled:
                settled = effort.steps + recipe.settling
                more = 0
                if slope is not None and spent >= recipe.counted:
                    more = _missing(field, footage, slope, effort.expected_steps)
                rearranged(*relocate(field, small, footage.taus, size, rng, recipe.moving, more))
        if slope is not None and spent >= pruning:
            pruning = next(prunings, 1.0)
            rearranged(_prune(field, footage, slope, rng))
        index = next(order)
        if shown is not frames and spent >= recipe.coarse:
            shown = frames
            targets, behind = targets_of(field, frames, size)
            rearranged(reorder(field, size))
        tensors = field.tensors()
        if quantise is not None and spent >= quantise_from:
            tensors = quantise(tensors)
        tau = float(footage.taus[index])
        gradients = field.gradients(tensors, tau, targets[index], size, behind)
        if price is not None and spent >= recipe.coarse:
            price.add(field, gradients)
        patience = min(1.0, math.pow(recipe.rated_steps / effort.expected_steps, 0.25))
        warm_up = min(1.0, (effort.steps + 1) / recipe.warm_up)
        with field.about_middle(gradients):
            factor = recipe.decay(spent) * patience * warm_up
            adam.step(gradients, factor, tensors, paces(field, recipe, size))
        field.limit()
        effort.advance()


def _missing(field: Field, footage: Footage, slope: Slope, steps: float) -> int:
    """Gaussians that are missing at a slope, at most as many as there are; below 0 = too many."""
    now = len(field.raw["position"])
    wanted = slope.gaussians(footage.pixels, _squared_error(field, footage), steps)
    return min(max(wanted, now // 2), 2 * now) - now


def _prune(
    field: Field, footage: Footage, slope: Slope, rng: np.random.Generator
) -> NDArray[np.intp]:
    """Drop Gaussians that are not worth their bits, and return which are left."""
    gop = field.gop()
    found = sensitivities(footage, gop, rng, field.backend)
    left = np.flatnonzero(slope.worthwhile(losses(gop, footage, found, field.backend)))
    field.rearrange(left)
    return left


def _squared_error(field: Field, footage: Footage) -> float:
    """Mean squared error over some frames, 8-bit codes."""
    frames, backend = footage.frames, field.backend
    shown = some_frames(len(frames), RELOCATION.frames)
    prepared = backend.prepare(field.drawn())
    pictures = backend.render(prepared, footage.taus[shown], footage.size, footage.size)
    return fmean(
        squared_error(picture, frames[index])
        for picture, index in zip(pictures, shown, strict=True)
    )


def targets_of(
    field: Field, frames: Frames, coded_size: tuple[int, int]
) -> tuple[Samples, Samples | None]:
    """Frames (F, H, W, 3) where the backend compares them, and the backdrop at their size."""
    size = frames.shape[2], frames.shape[1]
    behind = backdrop(field.background, size, coded_size, field.backend)
    return field.backend.upload(frames), behind


def coarse_frames(frames: Frames, recipe: Recipe) -> Frames:
    """Frames of half the size for the coarse stage; small frames as they are."""
    height, width = frames.shape[1:3]
    if not recipe.coarse or min(height, width) < recipe.coarse_min_side:
        return frames
    size = (width // 2, height // 2)
    return np.stack([cv2.resize(f, size, interpolation=cv2.INTER_AREA) for f in frames])
