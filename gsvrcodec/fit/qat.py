"""The publication's quantisation-aware training: the fit sees what a decoder will get."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import torch
from torch import Tensor

from gsvrcodec.fit.field import Tensors


def fake_quantiser(bits: Mapping[str, int]) -> Callable[[Tensors], Tensors]:
    """Quantisation of each component over its range, with a straight-through gradient.

    The values agree with `gsvrcodec.model.quantise.dequantised` but for rounding.

    Args:
        bits: of each attribute.
    """

    def quantise(tensors: Tensors) -> Tensors:
        out = {}
        for name, values in tensors.items():
            if name == "rotation":  # pi-periodic, and stored in [0, pi)
                values = values - (values.detach() / math.pi).floor() * math.pi
            if values.numel():
                values = _OverRange.apply(values, bits[name])  # type: ignore[no-untyped-call]
            out[name] = values
        return out

    return quantise


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
