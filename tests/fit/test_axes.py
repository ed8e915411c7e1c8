"""The axes that positions move along."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from gsvrcodec.fit.adam import axes_of

SIZE = (40, 30)
HALF = torch.tensor([20.0, 15.0])


def offsets(
    log_scale: list[list[float]], rotation: list[float], steps: list[list[float]]
) -> Tensor:
    """Pixels that steps along the axes move by, (N, 2)."""
    tensors = {"log_scale": torch.tensor(log_scale), "rotation": torch.tensor(rotation)}
    return (axes_of(tensors, SIZE) @ torch.tensor(steps)[:, :, None])[:, :, 0] * HALF


def test_by_hand() -> None:
    """Of scales 1 and 4 px the mean is 2 px; the first axis of the second Gaussian points down."""
    shapes = [[0.0, math.log(4)], [math.log(4), 0.0]], [0.0, math.pi / 2]
    found = offsets(*shapes, [[1.0, 0.5], [1.0, 0.0]])
    torch.testing.assert_close(found, torch.tensor([[0.5, 1.0], [0.0, 2.0]]))


def test_axes_are_not_too_long_or_short() -> None:
    found = offsets([[-9.0, 9.0]], [0.0], [[1.0, 1.0]])
    torch.testing.assert_close(found, torch.tensor([[0.3, 3.0]]))
