"""Optimisation: error falls on real pictures, and nothing leaves the finite."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, get_args

import numpy as np
import pytest

from gsvrcodec.fit.footage import Frames
from gsvrcodec.fit.optimise import Effort, Every, optimise, visits
from gsvrcodec.fit.paper import PAPER, random_start
from gsvrcodec.fit.parameters import Parameters, Tensors
from gsvrcodec.fit.recipe import MAIN, Deform, Recipe
from gsvrcodec.fit.relocate import relocate, reorder
from gsvrcodec.fit.target import Slope
from gsvrcodec.fit.tuned import EFFORT
from gsvrcodec.render import render_frames
from tests import making
from tests.fit.synthetic import BACKEND, assert_finite, footage, sample, times


def quality(parameters: Parameters, frames: Frames) -> float:
    """Return the mean PSNR, dB."""
    size = frames.shape[2], frames.shape[1]
    shown = render_frames(parameters.gop(), times(len(frames)), size, size)
    return float(np.mean([making.psnr(a, b) for a, b in zip(frames, shown, strict=True)]))


def fitted(
    frames: Frames,
    steps: int,
    *,
    recipe: Recipe = MAIN,
    deform: Deform = "hybrid",
    quantise: Callable[[Tensors], Tensors] | None = None,
) -> tuple[Parameters, float]:
    """Return a fitted parameters, and how much PSNR it won from a random start."""
    rng = np.random.default_rng(0)
    grid = (0, 0, 0) if deform == "polynomial" else (8, 6, len(frames))
    parameters = Parameters(random_start(frames, 150, grid, rng), deform, BACKEND)
    before = quality(parameters, frames)
    optimise(
        parameters,
        footage(frames),
        recipe,
        Effort(steps),
        rng,
        quantise=quantise,
        quantise_from=0.5,
    )
    assert_finite(parameters.gop())
    return parameters, quality(parameters, frames) - before


@pytest.mark.parametrize("deform", get_args(Deform))
@pytest.mark.parametrize("recipe", [MAIN, PAPER], ids=["main", "paper"])
def test_psnr_rises(recipe: Recipe, deform: Deform) -> None:
    frames = sample(making.BUNNY_SMALL, (96, 64), 4)
    assert fitted(frames, 150, recipe=recipe, deform=deform)[1] > 6


def test_more_steps_are_better() -> None:
    frames = sample(making.BUNNY_SMALL, (96, 64), 4)
    assert fitted(frames, 400)[1] > fitted(frames, 60)[1] + 1


@pytest.mark.parametrize("level", [0, 255])
def test_flat_pictures(level: int) -> None:
    parameters, _ = fitted(np.full((3, 40, 56, 3), level, np.uint8), 150)
    assert quality(parameters, np.full((3, 40, 56, 3), level, np.uint8)) > 20


def test_quantiser_is_applied_late() -> None:
    calls = []

    def quantise(tensors: Tensors) -> Tensors:
        calls.append(set(tensors))
        return tensors

    fitted(sample(making.NOISE, (48, 40), 2), 40, quantise=quantise)
    assert len(calls) == 20
    assert {"position", "colour", "xy"} <= calls[0]


def test_every_frame_has_its_turn_in_every_round() -> None:
    order = visits(5, np.random.default_rng(0))
    rounds = [[next(order) for _ in range(5)] for _ in range(4)]
    assert all(sorted(numbers) == [0, 1, 2, 3, 4] for numbers in rounds)
    assert len(set(map(tuple, rounds))) > 1


def test_the_ends_of_a_long_gop_come_more_often() -> None:
    frames = EFFORT.long_gop

    def shown(count: int, ends: bool) -> list[int]:
        order = visits(count, np.random.default_rng(0), ends=ends)
        steps = EFFORT.ends_every * count + 2
        numbers = [next(order) for _ in range(steps)]
        return [numbers.count(frame) for frame in range(count)]

    usual, more = EFFORT.ends_every, EFFORT.ends_every + 1
    assert shown(frames, ends=True) == [more, *[usual] * (frames - 2), more]
    for counts in (shown(frames, ends=False), shown(frames - 1, ends=True)):
        assert set(counts) == {usual, more}
        assert sum(counts) == len(counts) * usual + 2


def first_rate(name: str) -> float:
    """Return the length of the first step of `MAIN`, which the gradient agrees with."""
    rate = MAIN.rates[name]
    assert isinstance(rate, float)
    return rate * MAIN.rule.agreeing * MAIN.decay(0) / MAIN.warm_up


class TestPruning:
    @staticmethod
    def counts(slope: Slope | None, recipe: Recipe) -> list[int]:
        """Return the number of Gaussians after each step of a fit that begins with 150."""
        frames = sample(making.BUNNY_SMALL, (96, 64), 4)
        start = random_start(frames, 150, (8, 6, 4), np.random.default_rng(0))
        parameters = Parameters(start, "hybrid", BACKEND)
        counts: list[int] = []

        class Counting(Effort):
            def advance(self) -> None:
                super().advance()
                counts.append(len(parameters.raw["position"]))

        rng = np.random.default_rng(0)
        optimise(parameters, footage(frames), recipe, Counting(40), rng, slope=slope)
        assert_finite(parameters.gop())
        return counts

    def test_what_is_not_worth_its_bits_leaves_in_time(self) -> None:
        recipe = replace(MAIN, relocations=(), prunings=(0.5, 0.8))
        counts = self.counts(Slope(8.0, 10**6), recipe)
        assert set(counts[:20]) == {150}
        assert 0 < counts[20] < 150
        assert set(counts[20:32]) == {counts[20]}
        assert counts[-1] <= counts[20]

    def test_all_stay_where_bits_are_free_and_without_a_slope(self) -> None:
        recipe = replace(MAIN, relocations=())
        assert set(self.counts(Slope(0.0, 10**6), recipe)) == {150}
        assert set(self.counts(None, recipe)) == {150}


@pytest.mark.parametrize(("settling", "times"), [(0, [4, 8, 16, 24]), (10, [4, 16]), (41, [4])])
def test_relocations_wait_until_gaussians_have_settled(
    settling: int, times: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    frames = sample(making.BUNNY_SMALL, (96, 64), 4)
    start = random_start(frames, 50, (8, 6, 4), np.random.default_rng(0))
    effort, found = Effort(40), []

    def noting(*args: Any) -> Any:
        found.append(effort.steps)
        return relocate(*args)

    monkeypatch.setattr("gsvrcodec.fit.optimise.relocate", noting)
    recipe = replace(MAIN, relocations=(0.1, 0.2, 0.4, 0.6), settling=settling)
    parameters = Parameters(start, "hybrid", BACKEND)
    optimise(parameters, footage(frames), recipe, effort, np.random.default_rng(0))
    assert found == times


class TestRates:
    def test_lengths_are_pixels(self) -> None:
        # The same picture twice as large: the Gaussians move as many pixels a step.
        first = first_rate("linear")
        for scale in (1, 2):
            frames = sample(making.BUNNY_SMALL, (64 * scale, 48 * scale), 2)
            start = random_start(frames, 60, (0, 0, 0), np.random.default_rng(0))
            parameters = Parameters(start, "polynomial", BACKEND)
            reorder(parameters, (64 * scale, 48 * scale))
            before = parameters.gop().linear
            optimise(parameters, footage(frames), MAIN, Effort(1), np.random.default_rng(0))
            moved = np.abs(parameters.gop().linear - before).max(axis=0) * (32, 24) * scale
            np.testing.assert_allclose(moved, first, rtol=1e-3)

    def test_positions_move_in_proportion_to_scales(self) -> None:
        frames = sample(making.BUNNY_SMALL, (64, 48), 1)
        start = random_start(frames, 60, (0, 0, 0), np.random.default_rng(0))
        start.log_scale[:] = np.log([[1.0], [2.0]]).repeat(30, axis=0)
        parameters = Parameters(start, "polynomial", BACKEND)
        reorder(parameters, (64, 48))
        before = parameters.gop()
        optimise(parameters, footage(frames), MAIN, Effort(1), np.random.default_rng(0))
        moved = np.linalg.norm((parameters.gop().position - before.position) * (32, 24), axis=1)
        large = before.log_scale[:, 0] > 0.5
        rate = first_rate("position")
        # Adam's first step has the length of its rate along each axis.
        np.testing.assert_allclose(moved[large].max(), 2 * rate, rtol=1e-3)
        np.testing.assert_allclose(moved[~large].max(), rate, rtol=1e-3)

    def test_they_grow_over_the_first_steps(self) -> None:
        frames = sample(making.BUNNY_SMALL, (64, 48), 1)
        start = random_start(frames, 60, (0, 0, 0), np.random.default_rng(0))
        moves = []
        for steps in (1, 2):
            parameters = Parameters(start, "polynomial", BACKEND)
            reorder(parameters, (64, 48))
            before = parameters.gop().colour
            recipe = replace(MAIN, decay=lambda spent: 1.0, relocations=())
            optimise(parameters, footage(frames), recipe, Effort(steps), np.random.default_rng(0))
            moves.append(np.abs(parameters.gop().colour - before).max())
        assert moves[1] == pytest.approx(3 * moves[0], rel=0.1)

    def test_long_fits_go_slower(self) -> None:
        frames = sample(making.BUNNY_SMALL, (64, 48), 1)

        def first_move(steps: int) -> float:
            class Once(Effort):
                @property
                def spent(self) -> float:
                    return float(self.steps > 0)

            start = random_start(frames, 60, (0, 0, 0), np.random.default_rng(0))
            parameters = Parameters(start, "polynomial", BACKEND)
            reorder(parameters, (64, 48))
            before = parameters.gop().colour
            optimise(parameters, footage(frames), MAIN, Once(steps), np.random.default_rng(0))
            return float(np.abs(parameters.gop().colour - before).max())

        rated = int(MAIN.rated_steps)
        assert first_move(rated // 7) == pytest.approx(first_move(rated))
        assert first_move(16 * rated) == pytest.approx(first_move(rated) / 2, rel=1e-3)


class TestEffort:
    def test_expected_steps(self, monkeypatch: pytest.MonkeyPatch) -> None:
        now = 100.0
        monkeypatch.setattr("time.perf_counter", lambda: now)
        assert Effort(40).expected_steps == 40
        timed = Effort(40, seconds=10.0)
        assert timed.expected_steps == 40
        for _ in range(20):
            timed.advance()
        now = 102.5
        assert timed.expected_steps == 80

    def test_by_steps(self) -> None:
        effort = Effort(4)
        assert effort.spent == 0
        effort.advance()
        assert effort.spent == 0.25

    def test_by_time(self, monkeypatch: pytest.MonkeyPatch) -> None:
        now = 100.0
        monkeypatch.setattr("time.perf_counter", lambda: now)
        effort = Effort(4, seconds=2.0)
        effort.advance()
        assert effort.spent == 0
        now = 101.5
        assert effort.spent == 0.75


def test_every_few_steps() -> None:
    every = Every(3)
    assert [every.due() for _ in range(7)] == [True, False, False, True, False, False, True]
    every.again()
    assert [every.due() for _ in range(4)] == [True, False, False, True]
    assert [Every(1).due() for _ in range(2)] == [True, True]
