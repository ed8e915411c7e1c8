"""The price of changes: a predicted fit pays for the bits that its changes will take."""

from __future__ import annotations

import math

import torch
from torch import Tensor
from torch.nn.functional import avg_pool1d

from gsvrcodec.fit.anchor import LOOK
from gsvrcodec.fit.field import Field, Tensors
from gsvrcodec.fit.tuned import PREDICTION
from gsvrcodec.model.quantise import Steps

_MOTION = ("linear", "quadratic")


class Price:
    """Adds the slope of weight * log2(1 + |change| / step) to the gradients of changes.

    Without it a fit drifts along directions that hardly change the picture, and a change costs as
    much as the value. Motion pays for what differs from that of the neighbours in drawing order.

    Args:
        steps: quantiser steps of the attributes.
        weight: loss that one bit may cost.
        device: of the tensors.
    """

    def __init__(self, steps: Steps, weight: float, device: str) -> None:
        self._weight = weight / math.log(2)
        self._steps = {name: torch.tensor(steps[name], device=device) for name in (*LOOK, *_MOTION)}
        self._slopes: dict[str, Tensor] = {}
        self._added = 0

    def add(self, field: Field, gradients: Tensors) -> None:
        """Add the slopes to the gradients of a field, in place.

        They change slowly: they are computed anew in every `PREDICTION.priced_steps`-th call, and
        after `forget`.
        """
        if self._added % PREDICTION.priced_steps == 0:
            self._slopes = self._computed(field)
        self._added += 1
        for name, slope in self._slopes.items():
            gradients[name].add_(slope)

    def forget(self) -> None:
        """Compute the slopes anew in the next call: the Gaussians have another order."""
        self._added = 0

    def _computed(self, field: Field) -> dict[str, Tensor]:
        slopes = {}
        for name, step in self._steps.items():
            if name not in field.raw:
                continue
            value = field.raw[name]
            if name in _MOTION:
                apart = value - _usual(value)
                slopes[name] = self._weight * PREDICTION.motion_price * _slope(apart, step)
            else:
                columns = value.reshape(len(value), -1)
                slope = field.carried * _slope(columns, step)
                slopes[name] = self._weight * slope.reshape(value.shape)
        return slopes


def _slope(value: Tensor, step: Tensor) -> Tensor:
    """Derivative of ln(1 + |value| / step)."""
    return value.sign() / (value.abs() + step)


def _usual(value: Tensor) -> Tensor:
    """Mean of the neighbours in drawing order, (N, C)."""
    near = PREDICTION.near
    return avg_pool1d(value.T[None], near, 1, near // 2, count_include_pad=False)[0].T
