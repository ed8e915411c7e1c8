"""The publication's quantisation-aware training: the fit sees what a decoder will get."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import torch
from torch import Tensor

from gsvrcodec.fit.field import Tensors


def fake_quantiser(bits: Mapping[str, int]) -> Callable[[Tensors], Tensors]:
    """Quantisation of each component over its range.

    The values agree with `gsvrcodec.model.quantise.dequantised` but for rounding. Their gradients
    count as those of the values before (a straight-through estimate).

    Args:
        bits: of each attribute; others stay as they are.
    """

    def quantise(tensors: Tensors) -> Tensors:
        out = {}
        for name, values in tensors.items():
            if name == "rotation":  # pi-periodic, and stored in [0, pi)
                values = values - (values / math.pi).floor() * math.pi
            stored = name in bits and values.numel()
            out[name] = _over_range(values, bits[name]) if stored else values
        return out

    return quantise


def _over_range(values: Tensor, bits: int) -> Tensor:
    """Round to equal steps from the smallest value of a component to its largest."""
    columns = values.reshape(len(values), -1) if values.dim() < 3 else values.flatten(0, 1)
    low, high = torch.aminmax(columns, dim=0)
    step = ((high - low) / ((1 << bits) - 1)).clamp(min=torch.finfo(torch.float32).tiny)
    codes = ((columns - low) / step).round_()
    return codes.mul_(step).add_(low).view_as(values)
