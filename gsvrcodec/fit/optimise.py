"""Gradient descent of one GOP: Adam, one frame a step, coarse to fine."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import count
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.fit.adam import Adam, paces
from gsvrcodec.fit.footage import Footage, Frames, backdrop, halved
from gsvrcodec.fit.number import Number
from gsvrcodec.fit.parameters import Parameters, Tensors
from gsvrcodec.fit.price import Price
from gsvrcodec.fit.recipe import Recipe
from gsvrcodec.fit.relocate import relocate, reorder
from gsvrcodec.fit.target import Slope
from gsvrcodec.fit.tiles import Tiles
from gsvrcodec.fit.tuned import EFFORT, PRICE
from gsvrcodec.model.gop import Float32Array
from gsvrcodec.render.backend import Samples, Scalar

#: Steps after which their pace is known.
_PACE_STEPS = 10
#: Steps that are taken at the same paces and axes of Gaussians, which change slowly.
PACED_STEPS = 8


class Effort:
    """How much of a fit's effort is spent, in [0, 1]: by steps, or by wall time when given.

    Wall time runs from construction.
    """

    def __init__(
        self, steps: int, seconds: float | None = None, gaussians: float = math.inf
    ) -> None:
        self._steps, self._seconds = steps, seconds
        self.gaussians = gaussians  #: that this time suffices for
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


def visits(frames: int, rng: np.random.Generator, *, ends: bool = True) -> Iterator[int]:
    """Yield numbers of frames without end, each of them once in every round.

    In a long GOP the first and the last frame come once more every `EFFORT.ends_every` rounds, if
    `ends` is set: they have neighbours on one side alone, and so would be the worst.
    """
    several = ends and frames >= EFFORT.long_gop
    for number in count(1):
        yield from rng.permutation(frames).tolist()
        if several and number % EFFORT.ends_every == 0:
            yield from rng.permutation([0, frames - 1]).tolist()


def optimise(
    parameters: Parameters,
    footage: Footage,
    recipe: Recipe,
    effort: Effort,
    rng: np.random.Generator,
    *,
    price: Price | None = None,
    slope: Slope | None = None,
    tiles: Tiles | None = None,
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
        tiles: that steps look at, if the backend can leave some out; no coarse stage then.
        quantise: fake quantisation of the decoder's parameters.
        quantise_from: fraction of the effort after which `quantise` is applied.
    """
    descent = _Descent(parameters, footage, recipe, effort, rng, price, slope, tiles)
    relocations, prunings = _Events(recipe.relocations), _Events(recipe.prunings)
    while (spent := effort.spent) < 1.0:
        if relocations.due(spent):
            descent.relocate(spent)
        if prunings.due(spent):
            descent.prune()
        if spent >= recipe.coarse:
            descent.refine()
        descent.step(spent, quantise if spent >= quantise_from else None)
    descent.forget()


class Every:
    """Something that is due at the first of every `steps` steps."""

    def __init__(self, steps: int) -> None:
        self._steps, self._taken = steps, 0

    def due(self) -> bool:
        """Count a step, and return whether it is due in it."""
        self._taken += 1
        return (self._taken - 1) % self._steps == 0

    def again(self) -> None:
        """Make it due in the next step."""
        self._taken = 0


class _Events:
    """Fractions of the effort at which something happens, one after another."""

    def __init__(self, fractions: Sequence[float]) -> None:
        self._later = iter(fractions)
        self._next = next(self._later, 1.0)

    def due(self, spent: float) -> bool:
        """Return whether the next one is reached, and go on to the one after it."""
        reached = spent >= self._next
        if reached:
            self._next = next(self._later, 1.0)
        return reached


class _Kind(NamedTuple):
    """What a step does beside following the gradients."""

    paces: bool  #: looks anew at paces and axes of Gaussians
    priced: bool  #: bits have a price
    prices: bool  #: looks anew at prices


class _Descent:
    """Parameters on their way down: what is shown to them, and the state of Adam."""

    def __init__(
        self,
        parameters: Parameters,
        footage: Footage,
        recipe: Recipe,
        effort: Effort,
        rng: np.random.Generator,
        price: Price | None,
        slope: Slope | None,
        tiles: Tiles | None,
    ) -> None:
        self._parameters, self._footage, self._recipe = parameters, footage, recipe
        self._effort, self._rng = effort, rng
        self._price = price
        self._number = None if slope is None else Number(slope)
        self._tiles = tiles if parameters.backend.skips_tiles else None
        self._small = self._shown = halved(footage.frames) if recipe.coarse else footage.frames
        self._targets, self._behind = targets_of(parameters, self._shown, footage.size)
        reorder(parameters, footage.size)
        self._adam = Adam(parameters.raw, recipe, footage.size, parameters.backend)
        self._order = visits(len(footage.frames), rng, ends=recipe.ends)
        self._settled = 0  # so many steps have to be taken before another relocation
        self._paced, self._priced = Every(PACED_STEPS), Every(PRICE.steps)
        self._recorded: dict[_Kind, Callable[..., None]] = {}

    def relocate(self, spent: float) -> None:
        """Move the weakest Gaussians, and add or drop as many as the slope calls for."""
        effort, recipe, footage = self._effort, self._recipe, self._footage
        if effort.steps < self._settled:
            return
        self._settled = effort.steps + recipe.settling
        more = 0
        if self._number is not None and spent >= recipe.counted:
            more = self._number.missing(
                self._parameters, footage, effort.expected_steps, effort.gaussians
            )
        order, moved = relocate(
            self._parameters,
            self._small,
            footage.taus,
            footage.size,
            self._rng,
            recipe.moving,
            more,
            footage.moving,
        )
        self._rearranged(order, moved)

    def prune(self) -> None:
        """Drop the Gaussians that are not worth their bits, if there is a slope."""
        if self._number is not None:
            self._rearranged(self._number.prune(self._parameters, self._footage))

    def refine(self) -> None:
        """End the coarse stage, if it has not ended: show frames of the whole size."""
        if self._shown is self._footage.frames:
            return
        self._shown = self._footage.frames
        self._targets, self._behind = targets_of(self._parameters, self._shown, self._footage.size)
        self._rearranged(reorder(self._parameters, self._footage.size))

    def step(self, spent: float, quantise: Callable[[Tensors], Tensors] | None) -> None:
        """Take a step on the next frame."""
        recipe, effort, number = self._recipe, self._effort, self._effort.steps + 1
        patience = min(1.0, math.pow(recipe.rated_steps / effort.expected_steps, 0.25))
        warm_up = min(1.0, number / recipe.warm_up)
        factor = recipe.decay(spent) * patience * warm_up
        index = next(self._order)
        how = [float(self._footage.taus[index]), self._targets[index], factor, number]
        if self._tiles is not None:
            how.append(self._tiles.at(number))
        priced = self._price is not None and spent >= recipe.coarse
        kind = _Kind(self._paced.due(), priced, priced and self._priced.due())
        if quantise is not None:
            self._take(kind, quantise, *how)
        else:
            if kind not in self._recorded:
                step = partial(self._take, kind, None)
                self._recorded[kind] = self._parameters.backend.recorded(step)
            self._recorded[kind](*how)
        effort.advance()

    def forget(self) -> None:
        """Let go of recorded steps, which refer to this object and so would keep its frames."""
        self._recorded = {}

    def _take(
        self,
        kind: _Kind,
        quantise: Callable[[Tensors], Tensors] | None,
        tau: Scalar,
        target: Samples,
        factor: Scalar,
        number: Scalar,
        weights: Float32Array | None = None,
    ) -> None:
        """Take a step on one frame, as `Backend.recorded` wants it.

        Args:
            kind: what the step does.
            quantise: fake quantisation of the decoder's parameters.
            tau: time of the frame.
            target: the frame.
            factor: of all rates.
            number: of the step, from 1.
            weights: of the tiles of the frame.
        """
        parameters, size = self._parameters, self._footage.size
        tensors = parameters.tensors()
        if quantise is not None:
            tensors = quantise(tensors)
        gradients = parameters.gradients(tensors, tau, target, size, self._behind, weights)
        if self._price is not None and kind.priced:
            if kind.prices:
                self._price.look(parameters)
            self._price.add(gradients)
        if kind.paces:
            self._adam.look(tensors, paces(parameters, self._recipe, size))
        parameters.hold(gradients)
        self._adam.step(gradients, factor, number)
        parameters.limit()

    def _rearranged(self, order: NDArray[np.intp], moved: NDArray[np.bool_] | None = None) -> None:
        """Follow the parameters, which were put into another order."""
        if self._number is not None:
            self._number.rearranged(order, moved)
        self._adam.rearrange(order, moved)
        self.forget()
        self._paced.again()
        self._priced.again()
        if self._price is not None:
            self._price.forget()


def targets_of(
    parameters: Parameters, frames: Frames, coded_size: tuple[int, int]
) -> tuple[Samples, Samples | None]:
    """Frames (F, H, W, 3) where the backend compares them, and the backdrop at their size."""
    size = frames.shape[2], frames.shape[1]
    behind = backdrop(parameters.background, size, coded_size, parameters.backend)
    return parameters.backend.upload(frames), behind
