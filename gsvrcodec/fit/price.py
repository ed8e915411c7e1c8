"""The price of bits in a fit: of changes, and of what differs from its neighbours."""

from __future__ import annotations

import math

import torch
from torch import Tensor
from torch.nn.functional import pad

from gsvrcodec.fit.parameters import LOOK, MOTION, Parameters, Tensors, put
from gsvrcodec.fit.tuned import PRICE
from gsvrcodec.model.quantise import Steps


class Price:
    """Adds the slope of weight * log2(1 + |difference| / step) to the gradients of a fit.

    Without it a fit drifts along directions that hardly change the picture, and bits are spent on
    them. A Gaussian that is carried over pays for its changes. A new one pays for an opacity that
    is not 1, and for scales that differ from those of its neighbours in drawing order. All pay for
    motion that differs from that of their neighbours.

    Args:
        steps: quantiser steps of the attributes.
        weight: loss that one bit may cost.
        device: of the tensors.
    """

    def __init__(self, steps: Steps, weight: float, device: str) -> None:
        self._weight = weight / math.log(2)
        self._steps = {name: torch.tensor(steps[name], device=device) for name in (*LOOK, *MOTION)}
        self._slopes: dict[str, Tensor] = {}

    def add(self, gradients: Tensors) -> None:
        """Add the slopes to gradients, in place."""
        for name, slope in self._slopes.items():
            gradients[name].add_(slope)

    def look(self, parameters: Parameters) -> None:
        """Compute the slopes: before `add`, and again now and then, since they change slowly."""
        put(self._slopes, self._computed(parameters))

    def forget(self) -> None:
        """Forget the slopes: the Gaussians are others, or in another order."""
        self._slopes = {}

    def _computed(self, parameters: Parameters) -> dict[str, Tensor]:
        slopes = {}
        for name, step in self._steps.items():
            if name not in parameters.raw:
                continue
            value = parameters.raw[name]
            columns = value.reshape(len(value), -1)
            if name in MOTION:
                slope = PRICE.motion * _slope(columns - _usual(columns), step)
            else:
                slope = self._of_look(parameters, name, columns, step)
            slopes[name] = self._weight * slope.reshape(value.shape)
        return slopes

    def _of_look(self, parameters: Parameters, name: str, value: Tensor, step: Tensor) -> Tensor:
        """Slopes of an attribute whose changes are stored of carried Gaussians, (N, C)."""
        carried = parameters.carried
        total = torch.zeros_like(value)
        if carried is not None:
            total += PRICE.change * carried * _slope(value, step)
        new = 1.0 if carried is None else 1 - carried
        if name == "log_opacity":
            total += PRICE.log_opacity * new * _slope(value, step)
        elif name == "log_scale":
            total += PRICE.log_scale * new * _slope(value - _usual(value), step)
        return total


def _slope(value: Tensor, step: Tensor) -> Tensor:
    """Derivative of ln(1 + |value| / step)."""
    return value.sign() / (value.abs() + step)


def _usual(value: Tensor) -> Tensor:
    """Mean of the neighbours in drawing order, (N, C)."""
    side, last = PRICE.near // 2, len(value) - 1
    # A sum of shifted copies takes a fourth of the time of torch's own pooling.
    padded, total = pad(value, (0, 0, side, side)), torch.zeros_like(value)
    for shift in range(2 * side + 1):
        total += padded[shift : shift + len(value)]
    number = torch.arange(len(value), device=value.device)
    return total / (1 + number.clamp(max=side) + (last - number).clamp(max=side))[:, None]
