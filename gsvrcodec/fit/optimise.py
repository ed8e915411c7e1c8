"""Gradient descent of one GOP: Adam, one frame a step, coarse to fine."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from gsvrcodec.fit.field import Field, adam_step, squared_error
from gsvrcodec.fit.relocate import relocate, reorder
from gsvrcodec.model.gop import Float32Array

Frames = NDArray[np.uint8]
Tensors = dict[str, Tensor]


@dataclass(frozen=True, slots=True)
class Recipe:
    """Learning rates and schedule. Rates are Adam's, in the units of the raw parameters."""

    #: of each attribute, or of each of its components
    rates: Mapping[str, float | tuple[float, ...]]
    #: rates of positions and of their offsets are px of the frame, not halves of it
    in_pixels: bool
    #: longest fit that the rates are for; n times as many steps take rates a root of n smaller
    rated_steps: float
    betas: tuple[float, float]
    decay: Callable[[float], float]  #: factor of the rates, by the part of the effort spent
    coarse: float  #: part of the effort spent at half resolution
    relocations: tuple[float, ...]  #: parts of the effort after which weak Gaussians move
    coarse_min_side: int = 128  #: smaller frames are fitted at full resolution only


def _linear(spent: float) -> float:
    return 1 - 0.98 * spent


def _cosine(spent: float) -> float:
    return 0.02 + 0.98 * (1 + math.cos(math.pi * spent)) / 2


MAIN = Recipe(
    rates={
        "position": 0.9,
        "log_scale": 0.08,
        "rotation": 0.08,
        "colour": 0.02,
        "indicator": 0.04,
        "linear": 0.36,
        "quadratic": 0.36,
        # Offsets of position and scale (px), rotation and colour.
        "xy": (2.2, 2.2, 0.05, 0.05, 0.005, 0.005, 0.005, 0.005),
        "xt": 0.08,
        "yt": 0.08,
    },
    in_pixels=True,
    rated_steps=700,
    betas=(0.9, 0.98),
    decay=_linear,
    coarse=0.5,
    relocations=(0.15, 0.3, 0.45),
)

#: The publication's rates; no coarse stage.
PAPER = Recipe(
    rates={
        **dict.fromkeys(("position", "log_scale", "rotation", "colour"), 0.01),
        **dict.fromkeys(("indicator", "linear", "quadratic", "xy", "xt", "yt"), 0.0025),
    },
    in_pixels=False,
    rated_steps=math.inf,
    betas=(0.9, 0.999),
    decay=_cosine,
    coarse=0.0,
    relocations=(),
)

#: Attributes whose first two components are lengths along x and y.
_LENGTHS = frozenset(("position", "linear", "quadratic", "xy"))


class Adam:
    """Adam with a rate for each component of an attribute."""

    _EPSILON = 1e-15

    def __init__(self, raw: Tensors, recipe: Recipe, size: tuple[int, int], threads: int) -> None:
        self._raw, self._betas, self._threads = raw, recipe.betas, threads
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

    def step(self, factor: float) -> None:
        """Follow the gradients, at `factor` of the rates, and forget them."""
        self._steps += 1
        for name, tensor in self._raw.items():
            adam_step(
                tensor,
                self._mean[name],
                self._square[name],
                self._rates[name],
                factor,
                self._betas,
                self._EPSILON,
                self._steps,
                self._threads,
            )
            tensor.grad = None

    def rearrange(self, order: NDArray[np.intp], moved: NDArray[np.bool_] | None = None) -> None:
        """Keep step with Gaussians in a new order, some of which may start anew."""
        for name in self._raw.keys() - {"xy", "xt", "yt"}:
            for moments in (self._mean[name], self._square[name]):
                moments.copy_(moments[order])
                if moved is not None:
                    moments[moved] = 0.0


#: Steps after which their pace is known.
_FORESEEN_FROM = 10


class Effort:
    """How much of a fit's effort is spent, in [0, 1]: by steps, or by wall time when given."""

    def __init__(self, steps: int, seconds: float | None = None) -> None:
        self._steps, self._seconds = steps, seconds
        self._start = time.perf_counter()
        self._step = 0

    def advance(self) -> None:
        self._step += 1

    @property
    def spent(self) -> float:
        if self._seconds is None:
            return self._step / self._steps
        return (time.perf_counter() - self._start) / self._seconds

    @property
    def expected_steps(self) -> float:
        """Steps of the whole effort; foreseen from those taken so far when it goes by time."""
        if self._seconds is None or self._step < _FORESEEN_FROM:
            return self._steps
        return self._step / self.spent


def visits(frames: int, rng: np.random.Generator) -> Iterator[int]:
    """Yield numbers of frames without end, each of them once in every round."""
    while True:
        yield from rng.permutation(frames).tolist()


def optimise(
    field: Field,
    frames: Frames,
    taus: Float32Array,
    recipe: Recipe,
    effort: Effort,
    rng: np.random.Generator,
    *,
    quantise: Callable[[Tensors], Tensors] | None = None,
    quantise_from: float = 1.0,
    threads: int = 0,
) -> None:
    """Fit `field` to `frames` (F, H, W, 3), in place.

    Args:
        field: what is fitted.
        frames: uint8 frames of the GOP.
        taus: (F,) their normalised times.
        recipe: rates and schedule.
        effort: when to stop.
        rng: order of the frames.
        quantise: fake quantisation of the decoder's parameters.
        quantise_from: part of the effort after which it is applied.
        threads: native threads.
    """
    height, width = frames.shape[1:3]
    large = min(height, width) >= recipe.coarse_min_side
    coarse = _half(frames) if recipe.coarse and large else frames
    targets, backdrop = _goals(field, coarse, (width, height), threads)
    reorder(field, (width, height))
    adam = Adam(field.raw, recipe, (width, height), threads)
    order = visits(len(frames), rng)
    relocations = iter(recipe.relocations)
    relocation = next(relocations, 1.0)
    while (spent := effort.spent) < 1.0:
        if spent >= relocation:
            relocation = next(relocations, 1.0)
            adam.rearrange(*relocate(field, coarse, taus, (width, height), rng, threads))
        index = next(order)
        if coarse is not frames and spent >= recipe.coarse:
            coarse = frames
            targets, backdrop = _goals(field, frames, (width, height), threads)
            adam.rearrange(reorder(field, (width, height)))
        tensors = field.tensors()
        if quantise is not None and spent >= quantise_from:
            tensors = quantise(tensors)
        target, tau = targets[index], float(taus[index])
        loss = squared_error(tensors, tau, target, (width, height), threads, backdrop)
        loss.backward()  # type: ignore[no-untyped-call]
        patience = min(1.0, math.sqrt(recipe.rated_steps / effort.expected_steps))
        adam.step(recipe.decay(spent) * patience)
        effort.advance()


def _goals(
    field: Field, frames: Frames, coded_size: tuple[int, int], threads: int
) -> tuple[Frames | Tensor, Float32Array | Tensor | None]:
    """Frames to compare with, and what is drawn behind the field at their size."""
    size = frames.shape[2], frames.shape[1]
    return field.uploaded(frames), field.backdrop(size, coded_size, threads)


def _half(frames: Frames) -> Frames:
    height, width = frames.shape[1:3]
    size = (width // 2, height // 2)
    return np.stack([cv2.resize(f, size, interpolation=cv2.INTER_AREA) for f in frames])
