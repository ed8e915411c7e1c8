"""The axes that positions move along."""

from __future__ import annotations

import math

import pytest
import torch

from gsvrcodec.fit.adam import Axes
from tests.render import examples

SIZE = (40, 30)


def axes(log_scale: list[list[float]], rotation: list[float]) -> Axes:
    tensors = {"log_scale": torch.tensor(log_scale), "rotation": torch.tensor(rotation)}
    return Axes(tensors, SIZE)


def test_by_hand() -> None:
    """Of scales 1 and 4 px the mean is 2 px; the first axis of the second Gaussian points down."""
    own = axes([[0.0, math.log(4)], [math.log(4), 0.0]], [0.0, math.pi / 2])
    offset = own.offset(torch.tensor([[1.0, 0.5], [1.0, 0.0]]))
    half = torch.tensor([20.0, 15.0])
    torch.testing.assert_close(offset * half, torch.tensor([[0.5, 1.0], [0.0, 2.0]]))


def test_axes_are_not_too_long_or_short() -> None:
    own = axes([[-9.0, 9.0]], [0.0])
    offset = own.offset(torch.tensor([[1.0, 1.0]])) * torch.tensor([20.0, 15.0])
    torch.testing.assert_close(offset, torch.tensor([[0.3, 3.0]]))


def test_gradients_are_those_of_offsets() -> None:
    gop = examples.random_gop(50, grid=(0, 0, 0))
    own = axes(gop.log_scale.tolist(), gop.rotation.tolist())
    generator = torch.Generator().manual_seed(0)
    steps, gradient = torch.randn(2, 50, 2, generator=generator)
    by_steps = (own.gradient(gradient) * steps).sum().item()
    assert (gradient * own.offset(steps)).sum().item() == pytest.approx(by_steps, rel=1e-4)
