"""Steps follow what rounding does to the picture."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from gsvrcodec.fit.footage import Frames
from gsvrcodec.fit.parameters import MOTION
from gsvrcodec.fit.precision import (
    equal_slope_steps,
    refined_steps,
    sensitivities,
    steps_of_predicted,
    usual_qscale,
)
from gsvrcodec.fit.tuned import RATE_CONTROL, STEPS
from gsvrcodec.model.attributes import ATTRIBUTES, MEAN_CHANNELS
from gsvrcodec.model.gop import Gop
from gsvrcodec.model.quantise import Refined, dequantised, of_carried, short_step
from gsvrcodec.model.refinement import REFINED, levels
from gsvrcodec.model.static import select_gaussians
from tests import making
from tests.fit.synthetic import BACKEND, footage

SIZE = (96, 64)


def blank(frames: int) -> Frames:
    """Frames to say how many and how large they are."""
    return np.zeros((frames, SIZE[1], SIZE[0], 3), np.uint8)


def measured(gop: Gop, frames: int = 3) -> Gop:
    return sensitivities(footage(blank(frames)), gop, np.random.default_rng(0), BACKEND)


@pytest.fixture(scope="module")
def gop() -> Gop:
    return making.random_gop(np.random.default_rng(5), gaussians=150)


class TestSteps:
    def test_every_component_has_one(self, gop: Gop) -> None:
        found = measured(gop)
        steps = equal_slope_steps(found, 1.0)
        for attribute in ATTRIBUTES:
            assert len(steps[attribute.name]) == attribute.components
            assert all(0 < step < 1 for step in steps[attribute.name])
        (rotation,) = steps["rotation"]
        assert rotation == short_step(math.pi / round(math.pi / rotation))

    def test_they_grow_with_the_qscale(self, gop: Gop) -> None:
        found = measured(gop)
        fine, coarse = (equal_slope_steps(found, qscale) for qscale in (1e-2, 2e-2))
        assert coarse["colour"][0] == pytest.approx(2 * fine["colour"][0])

    def test_what_matters_more_gets_finer_steps(self, gop: Gop) -> None:
        found = measured(gop)
        more = replace(found, xy=4 * found.xy)
        before, after = (equal_slope_steps(each, 0.1)["xy"] for each in (found, more))
        half = np.array(before) / 2
        np.testing.assert_allclose(after[:MEAN_CHANNELS], half[:MEAN_CHANNELS], rtol=1e-6)
        # The other channels do nothing where pictures are means.
        assert set(after[MEAN_CHANNELS:]) == {STEPS.largest["xy"]}

    def test_no_tri_plane(self) -> None:
        bare = making.random_gop(np.random.default_rng(5), grid=(0, 0, 0))
        found = measured(bare, 1)
        assert len(equal_slope_steps(found, 1.0)["xy"]) == 8


def test_usual_qscale() -> None:
    sparse, dense = (usual_qscale(48 * 1280 * 640, n, 36.0) for n in (12000, 48000))
    assert sparse == pytest.approx(2 * dense)
    assert usual_qscale(48 * 1280 * 640, 12000, 30.0) == pytest.approx(2 * sparse, rel=0.01)
    assert usual_qscale(1, 10**6, 40.0) == RATE_CONTROL.finest
    assert usual_qscale(10**9, 1, 20.0) == RATE_CONTROL.coarsest


class TestRefined:
    def test_costs_no_more_than_one_step_for_all(self, gop: Gop) -> None:
        """Coarser base steps, finer ones where it matters: the same error by the sensitivities."""
        found = measured(gop)
        steps, refined = equal_slope_steps(found, 0.3), refined_steps(gop, found, 0.3)
        costs = []
        for precision in (steps, refined):
            decoded = dequantised(gop, precision)
            error = {n: np.square(getattr(decoded, n) - getattr(gop, n)) for n in REFINED}
            costs.append(sum(float((getattr(found, n) * e).sum()) for n, e in error.items()))
        assert costs[1] < 1.25 * costs[0]
        for name in REFINED:
            own, plain = refined[name], steps[name]
            assert isinstance(own, Refined)
            assert own.steps[0] >= 0.99 * plain[0]

    def test_a_gop_whose_gaussians_are_alike_has_the_plain_steps(self) -> None:
        one = making.random_gop(np.random.default_rng(5), gaussians=1)
        found = measured(one)
        plain, refined = equal_slope_steps(found, 0.3), refined_steps(one, found, 0.3)
        for name in REFINED:
            own = refined[name]
            assert isinstance(own, Refined)
            finest = own.steps[0] / 2**own.refinement.most
            assert finest <= 1.02 * plain[name][0]

    def test_rotations_of_slender_gaussians_are_finer_by_far(self, gop: Gop) -> None:
        """For them a radian costs e^4 = 5.8 octaves more than for round ones."""
        slender = np.arange(150) < 15
        scales = np.where(slender[:, None], [4.0, 0.0], [2.0, 2.0]).astype(np.float32)
        some = replace(gop, log_scale=scales, log_opacity=0 * gop.log_opacity)
        found = measured(some)
        cost = np.where(slender, np.exp(8.0), 1).astype(np.float32)
        found = replace(found, rotation=cost)
        (plain,) = equal_slope_steps(found, 0.02)["rotation"]
        refined = refined_steps(some, found, 0.02)["rotation"]
        assert isinstance(refined, Refined)
        (step,) = refined.steps
        assert step > 2 * STEPS.coarsest * plain
        bits = refined.refinement.bits(levels(some.log_scale, some.log_opacity)["rotation"])
        assert bits[slender].min() > STEPS.most_refined
        assert not bits[~slender].any()

    def test_no_gaussians(self) -> None:
        empty = making.random_gop(np.random.default_rng(5), gaussians=0)
        assert refined_steps(empty, empty, 1.0).keys() == equal_slope_steps(empty, 1.0).keys()


class TestPredicted:
    def test_new_and_carried_gaussians_have_steps_of_their_own(self, gop: Gop) -> None:
        carried = np.arange(150) < 100
        found = measured(gop)
        rare = replace(found, colour=np.where(carried[:, None], 16, 1) * found.colour)
        before, after = (steps_of_predicted(gop, each, carried, 0.01) for each in (found, rare))
        assert after["colour"] == before["colour"]
        usual, finer = (np.array(each["colour_change"]) for each in (before, after))
        np.testing.assert_allclose(finer, usual / 4, rtol=0.02)

    def test_what_is_not_stored_has_no_say(self, gop: Gop) -> None:
        carried = np.arange(150) < 100
        still = np.arange(150) % 2 == 0
        none = {name: np.where(still[:, None], 0, getattr(gop, name)) for name in MOTION}
        some = replace(gop, **none)
        found = measured(some)
        more = {name: np.where(still[:, None], 9, 1) * getattr(found, name) for name in MOTION}
        before, after = (
            steps_of_predicted(some, each, carried, 0.01)
            for each in (found, replace(found, **more))
        )
        assert before["carried_linear"] == after["carried_linear"]
        assert before["position_change"] == after["position_change"]

    def test_a_decoder_gets_values_of_both(self, gop: Gop) -> None:
        carried = np.arange(150) % 3 == 0
        precision = steps_of_predicted(gop, measured(gop), carried, 1.0)
        decoded = dequantised(gop, precision, carried)
        new = dequantised(select_gaussians(gop, ~carried), precision)
        changes = dequantised(select_gaussians(gop, carried), of_carried(precision))
        for attribute in ATTRIBUTES:
            value = getattr(decoded, attribute.name)
            if attribute.grid == "gaussians":
                np.testing.assert_array_equal(value[~carried], getattr(new, attribute.name))
                np.testing.assert_array_equal(value[carried], getattr(changes, attribute.name))
            else:
                np.testing.assert_array_equal(value, getattr(new, attribute.name))
        steps = of_carried(precision)["position"]
        assert steps == precision["position_change"]
        codes = decoded.position[carried] / np.array(steps)
        np.testing.assert_allclose(codes, np.rint(codes), atol=1e-3)
