"""Gradient descent of one GOP: Adam, one frame a step, coarse to fine."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from statistics import fmean

import cv2
import numpy as np
from numpy.typing import NDArray

from gsvrcodec.fit.adam import Adam, paces
from gsvrcodec.fit.footage import Footage, Frames, backdrop, some_frames
from gsvrcodec.fit.parameters import Parameters, Tensors
from gsvrcodec.fit.precision import sensitivities
from gsvrcodec.fit.price import Price
from gsvrcodec.fit.recipe import Recipe
from gsvrcodec.fit.relocate import losses, relocate, reorder
from gsvrcodec.fit.target import Slope
from gsvrcodec.fit.tuned import RELOCATION
from gsvrcodec.metrics import squared_error
from gsvrcodec.render.backend import Samples

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
    parameters: Parameters,
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
    """Fit `parameters` to `footage`, in place.

    Args:
        parameters: what the fit changes.
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
    targets, behind = targets_of(parameters, shown, size)
    reorder(parameters, size)
    adam = Adam(parameters.raw, recipe, size, parameters.backend)
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
                    more = _missing(parameters, footage, slope, effort.expected_steps)
                rearranged(
                    *relocate(parameters, small, footage.taus, size, rng, recipe.moving, more)
                )
        if slope is not None and spent >= pruning:
            pruning = next(prunings, 1.0)
            rearranged(_prune(parameters, footage, slope, rng))
        index = next(order)
        if shown is not frames and spent >= recipe.coarse:
            shown = frames
            targets, behind = targets_of(parameters, frames, size)
            rearranged(reorder(parameters, size))
        tensors = parameters.tensors()
        if quantise is not None and spent >= quantise_from:
            tensors = quantise(tensors)
        tau = float(footage.taus[index])
        gradients = parameters.gradients(tensors, tau, targets[index], size, behind)
        if price is not None and spent >= recipe.coarse:
            price.add(parameters, gradients)
        patience = min(1.0, math.pow(recipe.rated_steps / effort.expected_steps, 0.25))
        warm_up = min(1.0, (effort.steps + 1) / recipe.warm_up)
        with parameters.about_middle(gradients):
            factor = recipe.decay(spent) * patience * warm_up
            adam.step(gradients, factor, tensors, paces(parameters, recipe, size))
        parameters.limit()
        effort.advance()


def _missing(parameters: Parameters, footage: Footage, slope: Slope, steps: float) -> int:
    """Gaussians that are missing at a slope, at most as many as there are; below 0 = too many."""
    now = len(parameters.raw["position"])
    wanted = slope.gaussians(footage.pixels, _squared_error(parameters, footage), steps)
    return min(max(wanted, now // 2), 2 * now) - now


def _prune(
    parameters: Parameters, footage: Footage, slope: Slope, rng: np.random.Generator
) -> NDArray[np.intp]:
    """Drop Gaussians that are not worth their bits, and return which are left."""
    gop = parameters.gop()
    found = sensitivities(footage, gop, rng, parameters.backend)
    left = np.flatnonzero(slope.worthwhile(losses(gop, footage, found, parameters.backend)))
    parameters.rearrange(left)
    return left


def _squared_error(parameters: Parameters, footage: Footage) -> float:
    """Mean squared error over some frames, 8-bit codes."""
    frames, backend = footage.frames, parameters.backend
    shown = some_frames(len(frames), RELOCATION.frames)
    prepared = backend.prepare(parameters.drawn())
    pictures = backend.render(prepared, footage.taus[shown], footage.size, footage.size)
    return fmean(
        squared_error(picture, frames[index])
        for picture, index in zip(pictures, shown, strict=True)
    )


def targets_of(
    parameters: Parameters, frames: Frames, coded_size: tuple[int, int]
) -> tuple[Samples, Samples | None]:
    """Frames (F, H, W, 3) where the backend compares them, and the backdrop at their size."""
    size = frames.shape[2], frames.shape[1]
    behind = backdrop(parameters.background, size, coded_size, parameters.backend)
    return parameters.backend.upload(frames), behind


def coarse_frames(frames: Frames, recipe: Recipe) -> Frames:
    """Frames of half the size for the coarse stage; small frames as they are."""
    height, width = frames.shape[1:3]
    if not recipe.coarse or min(height, width) < recipe.coarse_min_side:
        return frames
    size = (width // 2, height // 2)
    return np.stack([cv2.resize(f, size, interpolation=cv2.INTER_AREA) for f in frames])
