"""Gradient descent of one GOP: Adam, one frame a step, coarse to fine."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from gsvrcodec.fit.field import Field, squared_error
from gsvrcodec.model.gop import Float32Array

Frames = NDArray[np.uint8]
Tensors = dict[str, Tensor]


@dataclass(frozen=True, slots=True)
class Recipe:
    """Learning rates and schedule. Rates are Adam's, in the units of the raw parameters."""

    rates: dict[str, float]
    betas: tuple[float, float] = (0.9, 0.99)
    final_rate: float = 0.02  #: of the initial rate, at the end of the cosine
    coarse: float = 0.5  #: part of the effort spent at half resolution
    coarse_min_side: int = 128  #: smaller frames are fitted at full resolution only


MAIN = Recipe(
    rates={
        "position": 0.002,
        "log_scale": 0.04,
        "rotation": 0.04,
        "colour": 0.02,
        "alpha": 0.04,
        "linear": 0.0008,
        "quadratic": 0.0008,
        "xy": 0.02,
        "xt": 0.02,
        "yt": 0.02,
    }
)

#: The publication's rates; no coarse stage.
PAPER = Recipe(
    rates={
        **dict.fromkeys(("position", "log_scale", "rotation", "colour"), 0.01),
        **dict.fromkeys(("alpha", "linear", "quadratic", "xy", "xt", "yt"), 0.0025),
    },
    betas=(0.9, 0.999),
    coarse=0.0,
)


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
    coarse = _half(frames) if min(height, width) >= recipe.coarse_min_side else frames
    groups = [
        {"params": [tensor], "lr": recipe.rates[name], "rate": recipe.rates[name]}
        for name, tensor in field.raw.items()
    ]
    adam = torch.optim.Adam(groups, betas=recipe.betas, eps=1e-15, fused=True)
    order: Iterator[int] = iter(())
    while (spent := effort.spent) < 1.0:
        index = next(order, None)
        if index is None:
            order = iter(rng.permutation(len(frames)).tolist())
            index = next(order)
        decay = (1 + math.cos(math.pi * spent)) / 2
        for group in adam.param_groups:
            group["lr"] = group["rate"] * (recipe.final_rate + (1 - recipe.final_rate) * decay)
        target = coarse[index] if spent < recipe.coarse else frames[index]
        tensors = field.tensors()
        if quantise is not None and spent >= quantise_from:
            tensors = quantise(tensors)
        loss = squared_error(tensors, float(taus[index]), target, (width, height), threads)
        loss.backward()  # type: ignore[no-untyped-call]
        adam.step()
        adam.zero_grad()
        effort.advance()


def _half(frames: Frames) -> Frames:
    height, width = frames.shape[1:3]
    size = (width // 2, height // 2)
    return np.stack([cv2.resize(f, size, interpolation=cv2.INTER_AREA) for f in frames])
