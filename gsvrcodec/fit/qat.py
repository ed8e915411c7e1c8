"""Quantisation-aware training: the fit sees the values that a decoder will get."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor

from gsvrcodec.model.quantise import Precision

Tensors = dict[str, Tensor]


def fake_quantiser(precision: Precision, device: str = "cpu") -> Callable[[Tensors], Tensors]:
    """Quantisation of each component, with a straight-through gradient.

    The values agree with `gsvrcodec.model.pack.dequantised` to rounding, and rotations to half
    circles too.

    Args:
        precision: bits of each attribute over its range, or steps of its components.
        device: where the values are.
    """
    steps = {
        name: torch.tensor(wanted[0] if len(wanted) == 1 else wanted, device=device)
        for name, wanted in precision.items()
        if not isinstance(wanted, int)
    }

    def quantise(tensors: Tensors) -> Tensors:
        out = dict(tensors)
        for name, values in tensors.items():
            wanted = precision[name]
            if isinstance(wanted, int) and values.numel():
                if name == "rotation":  # pi-periodic, and stored in [0, pi)
                    values = values - (values.detach() / math.pi).floor() * math.pi
                out[name] = _OverRange.apply(values, wanted)  # type: ignore[no-untyped-call]
        if steps:
            stored = _in_steps([out[name] for name in steps], [*steps.values()])
            out.update(zip(steps, stored, strict=True))
        return out

    return quantise


def _in_steps(values: list[Tensor], steps: list[Tensor]) -> tuple[Tensor, ...]:
    result: tuple[Tensor, ...] = _InSteps.apply(steps, *values)  # type: ignore[no-untyped-call]
    return result


class _InSteps(torch.autograd.Function):
    """The nearest whole multiples of steps; of all attributes at once, since calls cost too."""

    @staticmethod
    def forward(ctx: Any, steps: list[Tensor], *values: Tensor) -> tuple[Tensor, ...]:
        return tuple(
            (value / step).round_().mul_(step) for value, step in zip(values, steps, strict=True)
        )

    @staticmethod
    def backward(ctx: Any, *outputs: Tensor) -> Any:
        return None, *outputs


class _OverRange(torch.autograd.Function):
    """Equal steps from the smallest value of a component to its largest."""

    @staticmethod
    def forward(ctx: Any, values: Tensor, bits: int) -> Tensor:
        columns = values.reshape(len(values), -1) if values.dim() < 3 else values.flatten(0, 1)
        low, high = torch.aminmax(columns, dim=0)
        step = ((high - low) / ((1 << bits) - 1)).clamp(min=torch.finfo(torch.float32).tiny)
        codes = ((columns - low) / step).round_()
        return codes.mul_(step).add_(low).view_as(values)

    @staticmethod
    def backward(ctx: Any, *outputs: Tensor) -> Any:
        return outputs[0], None
