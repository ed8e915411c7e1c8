"""Recipes: a rate for all that is trained, and a schedule that falls."""

from __future__ import annotations

from itertools import pairwise
from typing import get_args

import numpy as np
import pytest

from gsvrcodec.encoder.settings import Preset
from gsvrcodec.fit.paper import PAPER
from gsvrcodec.fit.recipe import MAIN, Recipe
from gsvrcodec.fit.tuned import EFFORT, RATE_CONTROL, STEPS
from gsvrcodec.model.attributes import ATTRIBUTES, MEAN_CHANNELS


@pytest.mark.parametrize("recipe", [MAIN, PAPER], ids=["main", "paper"])
class TestRecipes:
    def test_every_component_has_a_rate(self, recipe: Recipe) -> None:
        assert set(recipe.rates) == {attribute.name for attribute in ATTRIBUTES}
        for attribute in ATTRIBUTES:
            rates = np.broadcast_to(recipe.rates[attribute.name], attribute.components)
            # Tri-planes of means have no colours.
            used = MEAN_CHANNELS if recipe is MAIN and attribute.name == "xy" else len(rates)
            assert (rates[:used] > 0).all()
            assert not rates[used:].any()

    def test_rates_fall_nearly_to_nothing(self, recipe: Recipe) -> None:
        factors = [recipe.decay(spent) for spent in np.linspace(0, 1, 21)]
        assert factors[0] == 1
        assert factors[-1] == pytest.approx(0.02)
        assert all(after < before for before, after in pairwise(factors))

    def test_relocations_leave_time_to_settle(self, recipe: Recipe) -> None:
        assert list(recipe.relocations) == sorted(recipe.relocations)
        assert all(0 < when < 0.7 for when in recipe.relocations)

    def test_what_has_just_moved_is_not_pruned(self, recipe: Recipe) -> None:
        for when in recipe.prunings:
            assert 0 < when < 0.95
            assert all(moved > when or when - moved > 0.04 for moved in recipe.relocations)


def test_constants_name_what_there_is() -> None:
    names = {attribute.name for attribute in ATTRIBUTES}
    assert set(STEPS.largest) == names
    assert set(STEPS.coarser) <= names
    assert set(EFFORT.frame_visits) == set(get_args(Preset))
    visits = [EFFORT.frame_visits[preset] for preset in get_args(Preset)]
    assert visits == sorted(visits)
    assert RATE_CONTROL.finest < 1 < RATE_CONTROL.coarsest
