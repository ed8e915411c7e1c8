"""The price of changes: its slope is that of the bits that changes take."""

from __future__ import annotations

import math

import numpy as np
import torch

from gsvrcodec.fit.anchor import LOOK
from gsvrcodec.fit.field import Field
from gsvrcodec.fit.options import Deform
from gsvrcodec.fit.price import Price
from gsvrcodec.fit.tuned import PREDICTION
from gsvrcodec.model.attributes import ATTRIBUTES
from tests.fit.synthetic import BACKEND
from tests.fit.test_anchor import example

WEIGHT = 0.003
STEPS = {a.name: (0.01 * (1 + a.id),) * a.components for a in ATTRIBUTES}


def priced(deform: Deform = "hybrid") -> tuple[Field, dict[str, np.ndarray]]:
    """A field, and what a price adds to the gradients of ones."""
    _, anchor, stored = example()
    field = Field(stored, deform, BACKEND, anchor=anchor)
    gradients = {name: torch.ones_like(tensor) for name, tensor in field.raw.items()}
    Price(STEPS, WEIGHT, BACKEND.device).add(field, gradients)
    return field, {name: gradient.numpy() - 1 for name, gradient in gradients.items()}


def prices(field: Field) -> dict[str, torch.Tensor]:
    """What a price adds to the gradients of zeros."""
    gradients = {name: torch.zeros_like(tensor) for name, tensor in field.raw.items()}
    Price(STEPS, WEIGHT, BACKEND.device).add(field, gradients)
    return gradients


def test_it_is_the_slope_of_bits() -> None:
    field, found = priced()
    for name in LOOK:
        change = field.raw[name].double().requires_grad_()
        bits = torch.log2(1 + change.abs() / STEPS[name][0])
        (slope,) = torch.autograd.grad(WEIGHT * bits.sum(), change)
        expected = slope.numpy()
        expected[20:] = 0  # new Gaussians have no change
        np.testing.assert_allclose(found[name], expected, atol=1e-5)
        assert np.abs(expected[:20]).max() > 10 * 1e-5


def test_no_change_costs_nothing() -> None:
    _, anchor, stored = example()
    for name in LOOK:
        getattr(stored, name)[:] = 0
    field = Field(stored, "hybrid", BACKEND, anchor=anchor)
    found = prices(field)
    assert not any(found[name].any() for name in LOOK)


def test_motion_pays_where_it_differs_from_that_of_its_neighbours() -> None:
    _, anchor, stored = example()
    for name in ("linear", "quadratic"):
        getattr(stored, name)[:] = 0.25
        getattr(stored, name)[9, 0] = 0.5
    field = Field(stored, "hybrid", BACKEND, anchor=anchor)
    found = prices(field)
    for name in ("linear", "quadratic"):
        apart = found[name].numpy()[:, 0]
        assert 0 < apart[9] < WEIGHT / math.log(2) / (0.2 + STEPS[name][0])
        # Its neighbours are drawn towards it, and nothing draws where all are the same.
        assert (apart[[8, 10]] < 0).all()
        assert not apart[27]
        assert not found[name].numpy()[:, 1].any()


def test_what_is_not_trained_is_no_matter() -> None:
    field, found = priced("triplane")
    assert "linear" not in field.raw
    assert np.abs(found["position"]).max() > 0
    assert not found["xy"].any()


def test_slopes_are_computed_anew_after_some_steps() -> None:
    _, anchor, stored = example()
    field = Field(stored, "hybrid", BACKEND, anchor=anchor)
    price = Price(STEPS, WEIGHT, BACKEND.device)

    def added() -> np.ndarray:
        gradients = {name: torch.zeros_like(tensor) for name, tensor in field.raw.items()}
        price.add(field, gradients)
        return gradients["position"].numpy()

    first = added()
    field.raw["position"][:] *= -3
    for _ in range(PREDICTION.priced_steps - 1):
        np.testing.assert_array_equal(added(), first)
    second = added()
    assert (second * first <= 0).all()
    assert (second != first).any()
    # Unless the Gaussians have another order.
    field.raw["position"][:] *= -1
    np.testing.assert_array_equal(added(), second)
    price.forget()
    assert (added() != second).any()
