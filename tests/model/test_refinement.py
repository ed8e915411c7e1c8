"""Levels of Gaussians: how much finer than others each of them is stored."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gsvrcodec.model.refinement import REFINED, Refinement, levels
from tests import making


def level(log_scale: tuple[float, float], log_opacity: float = 0.0) -> dict[str, int]:
    found = levels(np.array([log_scale], np.float32), np.array([log_opacity], np.float32))
    assert tuple(found) == REFINED
    return {name: int(value[0]) for name, value in found.items()}


def test_by_hand() -> None:
    """Scales of 8.1 and 2.1 px: an area of 2^4.08, a ratio of 2^1.9; an opacity of 2^-2.9."""
    found = level((math.log(8.1), math.log(2.1)), -2.9 * math.log(2))
    area, shape, opacity = 4, 1, -3
    assert found["colour"] == 3 * (area + opacity) // 8
    assert found["log_scale"] == (2 * area + 3 * opacity) // 8 == -1
    assert found["rotation"] == (2 * area + 8 * shape + 3 * opacity) // 8
    assert found["position"] == (3 * shape + 2 * opacity - area) // 8 == -1
    assert found["linear"] == found["quadratic"] == found["position"]


@pytest.mark.parametrize(
    ("octaves", "more"),
    [
        ((4, 4), {"log_scale": 2, "rotation": 2, "colour": 3, "position": -1}),
        ((4, -4), {"log_scale": 0, "rotation": 8, "colour": 0, "position": 3}),
    ],
)
def test_larger_and_longer_gaussians(octaves: tuple[int, int], more: dict[str, int]) -> None:
    """Scales of 16 times their size, or of a ratio of 256."""
    plain = level((0.01, 0.01))
    other = level((0.01 + octaves[0] * math.log(2), 0.01 + octaves[1] * math.log(2)))
    assert {name: other[name] - plain[name] for name in more} == more


def test_more_opaque_gaussians_have_more_bits() -> None:
    thin, opaque = (level((0.5, 0.5), 0.01 + 8 * n * math.log(2)) for n in (0, 1))
    found = {name: opaque[name] - thin[name] for name in REFINED}
    assert found == {
        "position": 2,
        "log_scale": 3,
        "rotation": 3,
        "colour": 3,
        "linear": 2,
        "quadratic": 2,
    }


def test_order_of_axes_does_not_matter() -> None:
    gop = making.random_gop(np.random.default_rng(3), gaussians=200)
    one = levels(gop.log_scale, gop.log_opacity)
    other = levels(gop.log_scale[:, ::-1], gop.log_opacity)
    for name in REFINED:
        np.testing.assert_array_equal(one[name], other[name])


def test_no_gaussians_have_no_levels() -> None:
    found = levels(np.empty((0, 2), np.float32), np.empty(0, np.float32))
    assert all(len(value) == 0 for value in found.values())


def test_bits_are_bounded() -> None:
    bits = Refinement(least=-1, most=3).bits(np.array([-5, -1, 0, 1, 2, 9]))
    assert bits.tolist() == [0, 0, 1, 2, 3, 3]
    assert not Refinement().bits(np.array([-5, 5])).any()
