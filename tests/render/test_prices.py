"""Slopes of prices: the native kernel beside the reference in float64, and beside derivatives."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor

from gsvrcodec.native import _core
from gsvrcodec.render.backend import Backend, Prices
from gsvrcodec.render.native import NativeBackend

NATIVE = NativeBackend(2)


def reference(value: Tensor, step: Tensor, carried: Tensor | None, prices: Prices) -> Tensor:
    """What any backend does that has no kernel for it, in float64."""
    exact = None if carried is None else carried.double()
    found: Tensor = Backend.price_slopes(NATIVE, value.double(), step.double(), exact, prices)
    return found


def slopes(
    value: Tensor, step: Tensor, carried: Tensor | None, prices: Prices, threads: int = 2
) -> Tensor:
    """What the kernel gives."""
    arrays = value.numpy(), step.numpy(), None if carried is None else carried.numpy()
    return torch.from_numpy(NativeBackend(threads).price_slopes(*arrays, prices))


def values(count: int, columns: int) -> tuple[Tensor, Tensor, Tensor]:
    """Values, of which one in five is 0; steps; which are carried over."""
    rng = np.random.default_rng(count)
    value = rng.normal(size=(count, columns)) * rng.integers(0, 5, (count, columns)).clip(0, 1)
    carried = rng.integers(0, 2, (count, 1))
    step = rng.uniform(0.01, 0.1, columns)
    one, two, three = (torch.from_numpy(np.asarray(a, np.float32)) for a in (value, step, carried))
    return one, two, three


@pytest.mark.parametrize("count", [1, 2, 9, 1024, 3000])
@pytest.mark.parametrize("columns", [1, 2, 3])
@pytest.mark.parametrize("prices", [Prices(3.0), Prices(3.0, 4.0), Prices(3.0, 0.4, 15)])
def test_the_kernel_agrees(count: int, columns: int, prices: Prices) -> None:
    value, step, carried = values(count, columns)
    for known in (carried, None):
        found = slopes(value, step, known, prices)
        wanted = reference(value, step, known, prices)
        # Where a value is hardly its neighbours' mean, rounding decides about the sign.
        close = torch.isclose(found.double(), wanted, rtol=1e-4, atol=1e-4)
        assert close.double().mean() > 0.995 or close.all()
        alone = slopes(value, step, known, prices, threads=1)
        assert torch.equal(alone, found)


def test_it_is_the_derivative_of_the_bits() -> None:
    value, step, carried = values(40, 2)
    value, step, carried = (tensor.double() for tensor in (value + 0.001, step, carried))
    value.requires_grad_()
    prices = Prices(3.0, 0.4)
    own = prices.change * carried + prices.fresh * (1 - carried)
    bits = (own * torch.log1p(value.abs() / step)).sum()
    found = reference(value.detach(), step, carried, prices)
    torch.testing.assert_close(found, torch.autograd.grad(bits, value)[0])


def test_the_usual_is_the_mean_of_the_neighbours_that_there_are() -> None:
    value = torch.arange(6, dtype=torch.float32)[:, None] ** 2
    means = [(0 + 1) / 2, (0 + 1 + 4) / 3, 14 / 3, 29 / 3, 50 / 3, (16 + 25) / 2]
    apart = value - torch.tensor(means)[:, None]
    step = torch.ones(1)
    found = slopes(value, step, None, Prices(0.0, 2.0, 3))
    torch.testing.assert_close(found, 2 * apart.sign() / (apart.abs() + 1))


@pytest.mark.parametrize("wrong", ["step", "carried", "out", "near"])
def test_wrong_shapes_are_refused(wrong: str) -> None:
    value, out = np.zeros((2, 4, 2), np.float32)
    step, carried, near = np.ones(2, np.float32), np.ones(4, np.float32), 3
    if wrong == "step":
        step = step[:1]
    elif wrong == "carried":
        carried = carried[:3]
    elif wrong == "out":
        out = np.zeros((3, 2), np.float32)
    else:
        near = -1
    with pytest.raises(ValueError, match=wrong):
        _core.price_slopes(value, step, carried, near, 1.0, 1.0, out)
