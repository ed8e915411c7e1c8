"""Levels of Gaussians: how much finer than others each of them is stored."""

from __future__ import annotations

import math

import numpy as np

from gsvrcodec.model.refinement import REFINED, Refinement, levels
from tests import making


def level(log_scale: tuple[float, float], colour: tuple[float, float, float]) -> dict[str, int]:
    found = levels(np.array([log_scale], np.float32), np.array([colour], np.float32))
    assert tuple(found) == REFINED
    return {name: int(value[0]) for name, value in found.items()}


def test_by_hand() -> None:
    """Scales of 8.1 and 2.1 px: an area of 2^4.08, a ratio of 2^1.9; a colour in 2^-2 .. 2^-1."""
    found = level((math.log(8.1), math.log(2.1)), (0.1, -0.3, 0.2))
    assert found["colour"] == 4 // 2
    assert found["log_scale"] == (4 - 2) // 2
    assert found["rotation"] == (2 * 4 + 5 * 1 - 4) // 4
    assert found["position"] == found["linear"] == found["quadratic"] == (3 * 1 - 8) // 8


def test_four_times_the_area_is_a_level_of_colours_and_scales() -> None:
    small, large = (level((s, s), (0.3, 0.3, 0.3)) for s in (0.01, 0.01 + math.log(2)))
    for name in ("colour", "log_scale", "rotation"):
        assert large[name] == small[name] + 1
    assert large["position"] == small["position"]


def test_twice_the_colour_is_a_level_of_all_but_colours() -> None:
    faint, strong = (level((0.5, 0.5), (0.0, c, 0.0)) for c in (0.2, -0.4))
    for name in set(REFINED) - {"colour"}:
        assert strong[name] == faint[name] + 1
    assert strong["colour"] == faint["colour"]


def test_black_is_as_the_faintest() -> None:
    assert level((1.0, 1.0), (0.0, 0.0, 0.0)) == level((1.0, 1.0), (1e-9, 0.0, 0.0))


def test_order_of_axes_does_not_matter() -> None:
    gop = making.random_gop(np.random.default_rng(3), gaussians=200)
    one, other = levels(gop.log_scale, gop.colour), levels(gop.log_scale[:, ::-1], gop.colour)
    for name in REFINED:
        np.testing.assert_array_equal(one[name], other[name])


def test_no_gaussians_have_no_levels() -> None:
    found = levels(np.empty((0, 2), np.float32), np.empty((0, 3), np.float32))
    assert all(len(value) == 0 for value in found.values())


def test_bits_are_bounded() -> None:
    bits = Refinement(least=-1, most=3).bits(np.array([-5, -1, 0, 1, 2, 9]))
    assert bits.tolist() == [0, 0, 1, 2, 3, 3]
    assert not Refinement().bits(np.array([-5, 5])).any()
