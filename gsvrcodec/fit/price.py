"""The price of changes: a predicted fit pays for the bits that its changes will take."""

from __future__ import annotations

import math

import torch
from torch.nn.functional import avg_pool1d

from gsvrcodec.fit.anchor import LOOK
from gsvrcodec.fit.field import Field
from gsvrcodec.fit.tuned import PREDICTION
from gsvrcodec.model.quantise import Steps


class Price:
    """Adds the slope of weight * log2(1 + |change| / step) to the gradients of changes.

    Without it a fit drifts along directions that hardly change the picture, and a change costs as
    much as the value.

    Args:
        steps: quantiser steps of the attributes.
        weight: loss that one bit may cost.
        device: of the tensors.
    """

    def __init__(self, steps: Steps, weight: float, device: str) -> None:
        self._weight = weight / math.log(2)
        self._near = PREDICTION.near
        self._motion = dict.fromkeys(("linear", "quadratic"), PREDICTION.motion_price)
        self._steps_of = {
            name: torch.tensor(steps[name], device=device) for name in ("linear", "quadratic")
        }
        self._steps = {name: torch.tensor(steps[name], device=device) for name in LOOK}

    def add(self, field: Field) -> None:
        """Add the slopes to the gradients of a field."""
        carried = field.carried
        for name, weight in self._motion.items():
            raw = field.raw.get(name)
            if raw is not None and raw.grad is not None:
                value = raw.detach()
                usual = avg_pool1d(
                    value.T[None], self._near, 1, self._near // 2, count_include_pad=False
                )[0].T
                apart = value - usual
                slope = apart.sign() / (apart.abs() + self._steps_of[name])
                raw.grad.add_(slope, alpha=self._weight * weight)
        for name, step in self._steps.items():
            if (raw := field.raw.get(name)) is not None and raw.grad is not None:
                change = raw.detach()
                if change.dim() == 1:
                    slope = change.sign() / (change.abs() + step[0]) * carried[:, 0]
                else:
                    slope = change.sign() / (change.abs() + step) * carried
                raw.grad.add_(slope, alpha=self._weight)
