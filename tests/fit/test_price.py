"""The price of bits: its slope is that of the bits that parameters take."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
import torch

from gsvrcodec.fit.parameters import LOOK, Parameters
from gsvrcodec.fit.price import Price
from gsvrcodec.fit.tuned import PRICE
from gsvrcodec.model.attributes import ATTRIBUTES
from gsvrcodec.model.gop import Float32Array
from tests.fit.anchored import CARRIED, key, predicted
from tests.fit.synthetic import BACKEND

WEIGHT = 0.003
STEPS = {a.name: (0.01 * (1 + a.id),) * a.components for a in ATTRIBUTES}


def prices(parameters: Parameters) -> dict[str, Float32Array]:
    """What a price adds to the gradients of ones."""
    gradients = {name: torch.ones_like(tensor) for name, tensor in parameters.raw.items()}
    Price(STEPS, WEIGHT, BACKEND.device).add(parameters, gradients)
    return {name: gradient.numpy() - 1 for name, gradient in gradients.items()}


def slope(values: Float32Array, step: float) -> Float32Array:
    """Slope of the price of values, by torch's own derivative."""
    leaf = torch.from_numpy(values).double().requires_grad_()
    bits = torch.log2(1 + leaf.abs() / step)
    (found,) = torch.autograd.grad(WEIGHT * bits.sum(), leaf)
    return np.asarray(found.numpy(), np.float32)


def neighbours(values: Float32Array) -> Float32Array:
    """Mean of up to `PRICE.near` neighbours in drawing order, of (N, C)."""
    reach = PRICE.near // 2
    near = [values[max(0, n - reach) : n + reach + 1].mean(axis=0) for n in range(len(values))]
    return np.stack(near)


def test_a_carried_gaussian_pays_for_its_changes() -> None:
    parameters = predicted()
    found = prices(parameters)
    for name in LOOK:
        expected = PRICE.change * slope(parameters.raw[name].numpy(), STEPS[name][0])
        np.testing.assert_allclose(found[name][:CARRIED], expected[:CARRIED], atol=1e-5)
        assert np.abs(expected[:CARRIED]).max() > 10 * 1e-5


@pytest.mark.parametrize(("make", "first"), [(key, 0), (predicted, CARRIED)])
def test_a_new_one_pays_for_opacity_and_scales(make: Callable[[], Parameters], first: int) -> None:
    parameters = make()
    found, raw = (
        prices(parameters),
        {name: tensor.numpy() for name, tensor in parameters.raw.items()},
    )
    opacity = PRICE.log_opacity * slope(raw["log_opacity"], STEPS["log_opacity"][0])
    apart = raw["log_scale"] - neighbours(raw["log_scale"])
    scale = PRICE.log_scale * slope(apart, STEPS["log_scale"][0])
    for name, expected in (("log_opacity", opacity), ("log_scale", scale)):
        np.testing.assert_allclose(found[name][first:], expected[first:], atol=1e-5)
        assert np.abs(expected[first:]).max() > 10 * 1e-5
    for name in ("position", "rotation", "colour"):
        assert not found[name][first:].any()


@pytest.mark.parametrize("make", [key, predicted])
def test_the_usual_costs_nothing(make: Callable[[], Parameters]) -> None:
    parameters = make()
    parameters.raw["log_opacity"][:] = 0
    parameters.raw["log_scale"][:] = 0 if parameters.anchor else 1.5
    for name in ("position", "rotation", "colour"):
        parameters.raw[name][:] = 0
    found = prices(parameters)
    assert not any(found[name].any() for name in LOOK)


@pytest.mark.parametrize("make", [key, predicted])
def test_motion_pays_where_it_differs_from_that_of_its_neighbours(
    make: Callable[[], Parameters],
) -> None:
    parameters = make()
    for name in ("linear", "quadratic"):
        parameters.raw[name][:] = 0.25
        parameters.raw[name][9, 0] = 0.5
    found = prices(parameters)
    for name in ("linear", "quadratic"):
        apart = found[name][:, 0]
        own = np.array([0.25 * (1 - 1 / PRICE.near)], np.float32)
        expected = PRICE.motion * float(slope(own, STEPS[name][0])[0])
        assert apart[9] == pytest.approx(expected, rel=1e-2)
        # Its neighbours are drawn towards it, and nothing draws where all are the same.
        assert (apart[[8, 10]] < 0).all()
        assert not apart[27]
        assert not found[name][:, 1].any()


def test_what_is_not_trained_is_no_matter() -> None:
    parameters = predicted("triplane")
    found = prices(parameters)
    assert "linear" not in parameters.raw
    assert np.abs(found["position"]).max() > 0
    assert not any(found[name].any() for name in ("xy", "xt", "yt"))


def test_it_grows_with_what_a_bit_is_worth() -> None:
    parameters = key()
    found = []
    for weight in (WEIGHT, 2 * WEIGHT):
        gradients = {name: torch.zeros_like(tensor) for name, tensor in parameters.raw.items()}
        Price(STEPS, weight, BACKEND.device).add(parameters, gradients)
        found.append(gradients["log_opacity"].numpy())
    np.testing.assert_allclose(found[1], 2 * found[0], rtol=1e-6)
    least = (
        WEIGHT / math.log(2) * PRICE.log_opacity / (np.abs(parameters.gop().log_opacity).max() + 1)
    )
    assert np.abs(found[0]).min() > least


def test_slopes_are_computed_anew_after_some_steps() -> None:
    parameters = predicted()
    price = Price(STEPS, WEIGHT, BACKEND.device)

    def added() -> Float32Array:
        gradients = {name: torch.zeros_like(tensor) for name, tensor in parameters.raw.items()}
        price.add(parameters, gradients)
        return np.asarray(gradients["position"].numpy())

    first = added()
    parameters.raw["position"][:] *= -3
    for _ in range(PRICE.steps - 1):
        np.testing.assert_array_equal(added(), first)
    second = added()
    assert (second * first <= 0).all()
    assert (second != first).any()
    # Unless the Gaussians have another order.
    parameters.raw["position"][:] *= -1
    np.testing.assert_array_equal(added(), second)
    price.forget()
    assert (added() != second).any()
