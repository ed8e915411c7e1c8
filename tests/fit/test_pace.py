"""Paces: what is new or fast takes larger steps, what is slender smaller turns."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from gsvrcodec.fit.adam import Adam, paces
from gsvrcodec.fit.paper import PAPER
from gsvrcodec.fit.parameters import Parameters
from gsvrcodec.fit.recipe import MAIN, PREDICTED, Recipe
from gsvrcodec.model.gop import Float32Array
from tests.fit.anchored import CARRIED, key, predicted
from tests.fit.synthetic import BACKEND

SIZE = (200, 100)


def test_key_gops_have_the_rates_of_the_recipe() -> None:
    assert paces(key(), MAIN, SIZE) == {}
    assert paces(key(), PAPER, SIZE) == {}


def test_new_gaussians_are_faster() -> None:
    found = paces(predicted(), replace(PREDICTED, new=2.0, fast=0.0), SIZE)
    assert set(found) == set(predicted().raw) - {"xy", "xt", "yt"}
    for pace in found.values():
        np.testing.assert_array_equal(pace.flatten(), [1] * CARRIED + [2] * 8)


def test_fast_motion_has_larger_rates() -> None:
    parameters = key()
    parameters.raw["linear"][:] = 0
    parameters.raw["linear"][1] = 0.03, 0.08  # 3 and 4 px
    parameters.raw["linear"][2] = 100.0, 0.0
    found = paces(parameters, replace(MAIN, fast=3.0, fast_px=2.0), SIZE)
    assert set(found) == {"linear", "quadratic"}
    for pace in found.values():
        np.testing.assert_allclose(pace[:4, 0], [1, 1 + 3 * 5 / 7, 4, 1], atol=2e-3)


def test_a_pace_is_a_factor_of_the_step() -> None:
    def steps(pace: float | None) -> dict[str, Float32Array]:
        parameters: Parameters = key()
        before = {name: array.copy() for name, array in parameters.raw.items()}
        rng = np.random.default_rng(1)
        gradients = {n: rng.standard_normal(a.shape, np.float32) for n, a in before.items()}
        given = None if pace is None else {"position": np.full((28, 1), pace, np.float32)}
        adam = Adam(parameters.raw, MAIN, SIZE, BACKEND)
        adam.look(parameters.tensors(), given)
        adam.step(gradients, 0.1, 1)
        return {name: parameters.raw[name] - before[name] for name in before}

    usual, same, thrice = steps(None), steps(1.0), steps(3.0)
    for name, step in usual.items():
        np.testing.assert_allclose(same[name], step, rtol=1e-6, atol=1e-7)
        wanted = 3 * step if name == "position" else step
        np.testing.assert_allclose(thrice[name], wanted, atol=1e-6, rtol=1e-4)


@pytest.mark.parametrize(("recipe", "share"), [(MAIN, 0.25), (PAPER, 1.0)])
def test_slender_gaussians_turn_slowly(recipe: Recipe, share: float) -> None:
    parameters = key()
    parameters.raw["log_scale"][:] = 1.0
    parameters.raw["log_scale"][0, 1] += math.log(4)
    before = parameters.raw["rotation"].copy()
    adam = Adam(parameters.raw, recipe, SIZE, BACKEND)
    adam.look(parameters.tensors())
    adam.step({name: np.ones_like(t) for name, t in parameters.raw.items()}, 0.1, 1)
    turned = before - parameters.raw["rotation"]
    np.testing.assert_allclose(turned[0] / turned[1], share, rtol=1e-3)


def test_a_gradient_that_opposes_holds_gaussians_but_not_the_tri_plane() -> None:
    parameters = key()
    adam = Adam(parameters.raw, MAIN, SIZE, BACKEND)
    slopes = {name: np.ones_like(t) for name, t in parameters.raw.items()}
    adam.step(slopes, 0.1, 1)
    before = {name: array.copy() for name, array in parameters.raw.items()}
    adam.step({name: -0.1 * slope for name, slope in slopes.items()}, 0.1, 2)
    moved = {name for name, t in parameters.raw.items() if not np.array_equal(t, before[name])}
    assert moved == {"xy", "xt", "yt"}
