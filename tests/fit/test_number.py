"""The number of Gaussians follows what those that come save."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from gsvrcodec.fit.footage import Frames
from gsvrcodec.fit.number import Number, moving_of
from gsvrcodec.fit.optimise import Effort, optimise
from gsvrcodec.fit.parameters import Parameters
from gsvrcodec.fit.precision import still
from gsvrcodec.fit.recipe import MAIN
from gsvrcodec.fit.relocate import losses
from gsvrcodec.fit.start import content_aware
from gsvrcodec.fit.target import Slope
from gsvrcodec.fit.tuned import SLOPE
from gsvrcodec.model.reconstruction import MOST_LOG_OPACITY
from tests import making
from tests.fit.synthetic import BACKEND, footage, moving_texture

SIZE = 96, 64


def fitted(frames: Frames, slope: Slope | None = None) -> Parameters:
    """Return 60 Gaussians, or as many as a slope calls for, after 200 steps."""
    rng, shown = np.random.default_rng(0), footage(frames)
    start = content_aware(shown, 60, (0, 0, 0), None, rng, BACKEND)
    parameters = Parameters(start, "polynomial", BACKEND)
    recipe = replace(MAIN, prunings=())
    optimise(parameters, shown, recipe, Effort(200), rng, slope=slope)
    return parameters


def test_fewer_where_the_error_is_noise() -> None:
    """Detail that more Gaussians show, and noise of a quarter of its variance that none follows."""
    detail = np.repeat(moving_texture(1, (0, 0), SIZE), 4, axis=0)
    noise = np.random.default_rng(0).normal(0, detail.std() / 2, detail.shape)
    noisy = (128 + noise).clip(0, 255).round().astype(np.uint8)
    slope = Slope(2.0, 10**6)
    some, few = (len(fitted(frames, slope).raw["position"]) for frames in (detail, noisy))
    assert some > 2 * few


def test_those_that_came_last_are_looked_at() -> None:
    frames = moving_texture(3, (0.5, 0), SIZE)
    parameters, slope = fitted(frames), Slope(3.5, 10**6)
    hidden, same = np.arange(10), np.arange(len(parameters.raw["position"]))
    parameters.renew(hidden, hidden, log_opacity=np.full(10, -MOST_LOG_OPACITY, np.float32))
    strong = np.argsort(losses(parameters.gop(), footage(frames), BACKEND))[-10:]

    def missing(*orders: tuple[NDArray[np.intp], NDArray[np.bool_] | None]) -> int:
        number = Number(slope)
        for order, moved in orders:
            number.rearranged(order, moved)
        return number.missing(parameters, footage(frames), SLOPE.steps, math.inf)

    came = [np.isin(same, chosen) for chosen in (hidden, strong)]
    few, many = (missing((same, moved)) for moved in came)
    assert few < missing() < many
    # They are followed into another order.
    back = same[::-1]
    assert missing((same, came[0][::-1]), (back, None)) == few


def test_those_left_by_a_pruning_are_no_fair_sample() -> None:
    frames = moving_texture(3, (0.5, 0), SIZE)
    parameters, number = fitted(frames), Number(Slope(2.0, 10**6))
    number.rearranged(np.arange(60), np.ones(60, np.bool_))
    left = number.prune(parameters, footage(frames))
    number.rearranged(left, None)
    unknown = Number(Slope(2.0, 10**6))
    counts = (
        n.missing(parameters, footage(frames), SLOPE.steps, math.inf) for n in (number, unknown)
    )
    assert len(set(counts)) == 1


def test_what_moves_by_half_a_pixel_moves() -> None:
    gop = still(making.random_gop(np.random.default_rng(0), 6))
    gop.linear[1:4, 0] = 2 / 96 * np.array([0.4, 0.6, -0.6])
    gop.linear[4, 1] = 2 / 64 * 0.3
    gop.quadratic[4] = 2 / 64 * 0.3
    assert moving_of(gop, SIZE).tolist() == [False, False, True, True, True, False]


class TestPaid:
    def test_grows_with_what_they_save(self) -> None:
        slope = Slope(2.0, 10**9, lasting=3.0)
        usual = SLOPE.paid_usual * SLOPE.gaussian_bits * slope.bit
        found = [slope.paid(share * usual * np.ones(5), 0.0) for share in (0.5, 1.0, 1.5)]
        assert found == pytest.approx([share**SLOPE.paid_power for share in (0.5, 1.0, 1.5)])

    def test_more_bits_where_they_move(self) -> None:
        slope = Slope(2.0, 10**9)
        found = SLOPE.paid_usual * SLOPE.gaussian_bits * slope.bit * np.ones(3)
        assert slope.paid(found, 1.0) < slope.paid(found, 0.5) < slope.paid(found, 0.0)

    @pytest.mark.parametrize("qscale", [0.0, 1.0])
    def test_bounds(self, qscale: float) -> None:
        low, high = SLOPE.paid_range
        assert Slope(qscale, 500).paid(np.full(3, 1e12), 0.0) == high
        assert Slope(1.0, 500).paid(np.zeros(3), 0.0) == low
