"""The price of bits: its slope is that of the bits that parameters take."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from gsvrcodec.fit.parameters import LOOK, Parameters
from gsvrcodec.fit.price import Price
from gsvrcodec.model.attributes import ATTRIBUTES
from gsvrcodec.model.gop import Float32Array
from tests.fit.anchored import CARRIED, key, predicted
from tests.fit.synthetic import BACKEND

WEIGHT = 0.003
STEPS = {a.name: (0.01 * (1 + a.id),) * a.components for a in ATTRIBUTES}


def prices(parameters: Parameters) -> dict[str, Float32Array]:
    """What a price adds to the gradients of ones."""
    gradients = {name: np.ones_like(tensor) for name, tensor in parameters.raw.items()}
    price = Price(STEPS, WEIGHT, BACKEND)
    price.look(parameters)
    price.add(gradients)
    return {name: gradient - 1 for name, gradient in gradients.items()}


@pytest.mark.parametrize(
    ("make", "names", "part"),
    [
        (predicted, LOOK, slice(CARRIED)),  # a carried one pays for its changes
        (predicted, ("log_opacity",), slice(CARRIED, None)),  # a new one for its opacity
        (key, ("log_opacity",), slice(None)),
    ],
)
def test_it_draws_values_to_nothing(
    make: Callable[[], Parameters], names: tuple[str, ...], part: slice
) -> None:
    """Near it most, for the first bits of a value are the dearest."""
    parameters = make()
    found = prices(parameters)
    for name in names:
        value, slope = parameters.changes()[name][part].ravel(), found[name][part].ravel()
        if parameters.anchor is not None:  # by what is stored
            slope = slope * getattr(parameters.anchor.units, name)[part].ravel()
        # 1 was added to each slope and taken away again.
        np.testing.assert_array_equal(np.sign(slope), np.sign(value))
        order = np.argsort(np.abs(value))
        assert (np.diff(np.abs(slope)[order]) <= 1e-6).all() or len(STEPS[name]) > 1


#: The motion of 28 Gaussians that stand still.
STILL = {name: np.zeros((28, 2), np.float32) for name in ("linear", "quadratic")}
#: The looks of 28 Gaussians of which nothing is stored.
NOTHING = {
    "position": np.zeros((28, 2), np.float32),
    "log_scale": np.zeros((28, 2), np.float32),
    "rotation": np.zeros(28, np.float32),
    "colour": np.zeros((28, 3), np.float32),
    "log_opacity": np.zeros(28, np.float32),
}


@pytest.mark.parametrize("make", [key, predicted])
def test_the_usual_costs_nothing(make: Callable[..., Parameters]) -> None:
    found = prices(make("hybrid", **NOTHING, **STILL))
    assert not any(found[name].any() for name in LOOK)


@pytest.mark.parametrize("make", [key, predicted])
def test_motion_pays_where_it_differs_from_that_of_its_neighbours(
    make: Callable[..., Parameters],
) -> None:
    way = np.full((28, 2), 0.25, np.float32)
    way[9, 0] = 0.5
    found = prices(make("hybrid", **NOTHING, linear=way, quadratic=way))
    for name in ("linear", "quadratic"):
        apart = found[name][:, 0]
        assert apart[9] > 0
        # Its neighbours are drawn towards it, and nothing draws where all are the same.
        assert (apart[[8, 10]] < 0).all()
        assert not apart[27]
        assert not found[name][:, 1].any()


def test_motion_pays_for_the_place_that_follows_it() -> None:
    """Where the reference leaves a Gaussian, which is stored, its motion begins."""
    place = np.zeros((28, 2), np.float32)
    place[:CARRIED, 0] = 0.5
    parameters = predicted("hybrid", **NOTHING | STILL | {"position": place})
    found = prices(parameters)
    assert parameters.anchor is not None
    start = parameters.anchor.start
    for name, factor in (("linear", start), ("quadratic", start**2)):
        np.testing.assert_allclose(found[name], factor * found["position"], rtol=1e-4, atol=1e-6)
        assert found[name][:CARRIED, 0].all()


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
        gradients = {name: np.zeros_like(tensor) for name, tensor in parameters.raw.items()}
        price = Price(STEPS, weight, BACKEND)
        price.look(parameters)
        price.add(gradients)
        found.append(gradients["log_opacity"])
    np.testing.assert_allclose(found[1], 2 * found[0], rtol=1e-6)
    assert np.abs(found[0]).min() > 0


def test_slopes_stay_until_it_looks_again() -> None:
    parameters = predicted()
    price = Price(STEPS, WEIGHT, BACKEND)

    def added() -> Float32Array:
        gradients = {name: np.zeros_like(tensor) for name, tensor in parameters.raw.items()}
        price.add(gradients)
        return np.asarray(gradients["position"])

    assert not added().any()
    price.look(parameters)
    first = added()
    parameters.raw["position"] -= 4 * parameters.changes()["position"]
    np.testing.assert_array_equal(added(), first)
    price.look(parameters)
    second = added()
    assert (second * first <= 0).all()
    assert (second != first).any()
    price.forget()
    assert not added().any()
