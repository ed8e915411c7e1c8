"""Steps follow what rounding does to the picture."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from gsvrcodec.fit.precision import equal_slope_steps, usual_factor
from gsvrcodec.fit.sensitivity import sensitivity
from gsvrcodec.fit.target import COARSEST, FINEST
from gsvrcodec.model.attributes import ATTRIBUTES
from gsvrcodec.model.gop import Gop
from gsvrcodec.native import _core
from gsvrcodec.render.native import parameters
from tests import making
from tests.fit.synthetic import times

SIZE = (96, 64)


def pictures(gop: Gop, taus: np.ndarray) -> np.ndarray:
    """Return unclamped frames, 255 = white."""
    out = np.empty((len(taus), SIZE[1], SIZE[0], 3), np.float32)
    _core.render_float(parameters(gop), taus, out, *SIZE, 1)
    return 255 * out


@pytest.fixture(scope="module")
def gop() -> Gop:
    return making.random_gop(np.random.default_rng(5), gaussians=150)


class TestSensitivity:
    @pytest.mark.parametrize("name", ["position", "log_scale", "xy"])
    def test_foresees_the_error_of_noise(self, gop: Gop, name: str) -> None:
        taus, rng = times(5), np.random.default_rng(1)
        draws = [sensitivity(gop, taus, SIZE, np.random.default_rng(s)) for s in range(8)]
        foreseen = float(np.mean([getattr(d, name).sum(dtype=np.float64) for d in draws]))
        values, seen, size = getattr(gop, name), [], math.sqrt(100 / foreseen)
        for _ in range(8):
            sign = (2 * rng.integers(0, 2, values.shape) - 1).astype(np.float32)
            moved = replace(gop, **{name: values + np.float32(size) * sign})
            error = np.square(pictures(moved, taus) - pictures(gop, taus)).sum() / 3
            seen.append(float(error) / size**2)
        assert np.mean(seen) == pytest.approx(foreseen, rel=0.35)

    def test_what_does_nothing_counts_nothing(self, gop: Gop) -> None:
        black = replace(gop, colour=np.zeros_like(gop.colour), xy=np.zeros_like(gop.xy))
        changes = sensitivity(black, times(3), SIZE, np.random.default_rng(0))
        assert not changes.position.any()
        assert changes.colour.any()

    def test_threads_do_not_matter(self, gop: Gop) -> None:
        one, two = (
            sensitivity(gop, times(3), SIZE, np.random.default_rng(0), threads)
            for threads in (1, 2)
        )
        for attribute in ATTRIBUTES:
            np.testing.assert_array_equal(
                getattr(one, attribute.name), getattr(two, attribute.name)
            )


class TestSteps:
    def test_every_component_has_one(self, gop: Gop) -> None:
        changes = sensitivity(gop, times(3), SIZE, np.random.default_rng(0))
        steps = equal_slope_steps(changes, 1.0)
        for attribute in ATTRIBUTES:
            assert len(steps[attribute.name]) == attribute.components
            assert all(0 < step < 1 for step in steps[attribute.name])
        (rotation,) = steps["rotation"]
        assert math.pi / rotation == pytest.approx(round(math.pi / rotation))

    def test_they_grow_with_the_factor(self, gop: Gop) -> None:
        changes = sensitivity(gop, times(3), SIZE, np.random.default_rng(0))
        fine, coarse = (equal_slope_steps(changes, factor) for factor in (1e-2, 2e-2))
        assert coarse["colour"][0] == pytest.approx(2 * fine["colour"][0])

    def test_what_matters_more_gets_finer_steps(self, gop: Gop) -> None:
        changes = sensitivity(gop, times(3), SIZE, np.random.default_rng(0))
        more = replace(changes, xy=4 * changes.xy)
        before, after = (equal_slope_steps(c, 0.1)["xy"] for c in (changes, more))
        np.testing.assert_allclose(after, np.array(before) / 2, rtol=1e-6)

    def test_no_tri_plane(self) -> None:
        bare = making.random_gop(np.random.default_rng(5), grid=(0, 0, 0))
        changes = sensitivity(bare, times(1), SIZE, np.random.default_rng(0))
        assert len(equal_slope_steps(changes, 1.0)["xy"]) == 8


def test_usual_factor() -> None:
    sparse, dense = (usual_factor(48 * 1280 * 640, n, 36.0) for n in (12000, 48000))
    assert sparse == pytest.approx(2 * dense)
    assert usual_factor(48 * 1280 * 640, 12000, 30.0) == pytest.approx(2 * sparse, rel=0.01)
    assert usual_factor(1, 10**6, 40.0) == FINEST
    assert usual_factor(10**9, 1, 20.0) == COARSEST
