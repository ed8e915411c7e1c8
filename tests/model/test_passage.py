"""Passage: the pictures between a GOP and the next that is predicted from it."""

from __future__ import annotations

from typing import get_args

import numpy as np
import pytest

from gsvrcodec.model.gop import Gop
from gsvrcodec.model.passage import Passage
from gsvrcodec.model.prediction import DROPPED, carry_over
from gsvrcodec.model.reconstruction import Blending
from gsvrcodec.render.reference import ReferenceBackend
from tests.gops import make_carried, make_gop, make_modes

SIZE = (48, 32)


def picture(gop: Gop, tau: float, blending: Blending) -> np.ndarray:
    """One picture, as signed numbers."""
    backend = ReferenceBackend(blending)
    (codes,) = backend.render(backend.prepare(gop), np.array([tau], np.float32), SIZE, SIZE)
    return np.asarray(codes, int)


@pytest.mark.parametrize("blending", get_args(Blending))
@pytest.mark.parametrize("grid", [(0, 0, 0), (3, 2, 4)])
@pytest.mark.parametrize("frames", [(4, 3), (1, 3), (4, 1), (1, 1)])
def test_begins_and_ends_with_the_frames(
    grid: tuple[int, int, int], frames: tuple[int, int], blending: Blending
) -> None:
    before, new = make_gop(60, grid, 0, blending), make_gop(20, grid, 3, blending)
    mode = make_modes(60)
    # Behind all others, so that a share of 2^-16 of an opacity is none beside it.
    before.position[0], before.log_scale[0], mode[0] = 0, 4, 0
    after = carry_over(before, frames, make_carried(mode, 0, blending), new, blending)
    passage = Passage.of(before, after, mode != DROPPED, frames, blending)
    last = picture(before, 1 if frames[0] > 1 else 0, blending)
    first = picture(after, -1 if frames[1] > 1 else 0, blending)
    assert np.abs(last - first).max() > 20
    assert np.abs(picture(passage.at(0), 0, blending) - last).max() <= 1
    assert np.abs(picture(passage.at(1), 0, blending) - first).max() <= 1


def carried_and_all(blending: Blending) -> tuple[Gop, Gop, Passage]:
    """A GOP of 10 Gaussians, the GOP that is predicted from 8 of them and has 2 new ones."""
    before = make_gop(10, blending=blending)
    mode = np.array([0, 1, 2, 3, DROPPED] * 2, np.uint8)
    carried, new = make_carried(mode, 0, blending), make_gop(2, seed=3, blending=blending)
    after = carry_over(before, (3, 3), carried, new, blending)
    return before, after, Passage.of(before, after, mode != DROPPED, (3, 3), blending)


@pytest.mark.parametrize("blending", get_args(Blending))
def test_gaussians_go_in_a_straight_line(blending: Blending) -> None:
    _, _, passage = carried_and_all(blending)
    start, quarter, stop = (passage.at(weight) for weight in (0, 0.25, 1))
    assert len(quarter) == 8 + 2 + 2
    for name in ("position", "log_scale", "rotation", "colour", "log_opacity"):
        mean = 0.75 * getattr(start, name).astype(float) + 0.25 * getattr(stop, name)
        np.testing.assert_allclose(getattr(quarter, name)[:8], mean[:8], atol=1e-6)
    np.testing.assert_array_equal(start.position[8:], stop.position[8:])
    assert (start.position[:8] != stop.position[:8]).any()


def test_new_and_dropped_gaussians_of_means_fade_by_their_opacity() -> None:
    before, after, passage = carried_and_all("mean")
    quarter = passage.at(0.25)
    opacities = np.exp(quarter.log_opacity)
    np.testing.assert_allclose(opacities[8:10], 0.25 * np.exp(after.log_opacity[8:]), rtol=1e-6)
    np.testing.assert_allclose(opacities[10:], 0.75 * np.exp(before.log_opacity[4::5]), rtol=1e-6)
    np.testing.assert_array_equal(quarter.colour[8:10], after.colour[8:])
    np.testing.assert_array_equal(quarter.colour[10:], before.colour[4::5])
    # At the ends a share is left, so that the logarithm is finite.
    least = np.exp(passage.at(0).log_opacity[8:10])
    np.testing.assert_allclose(least, 2.0**-16 * np.exp(after.log_opacity[8:]), rtol=1e-5)


def test_new_and_dropped_gaussians_of_sums_fade_by_their_colour() -> None:
    before, after, passage = carried_and_all("sum")
    quarter = passage.at(0.25)
    np.testing.assert_allclose(quarter.colour[8:10], 0.25 * after.colour[8:], atol=1e-6)
    np.testing.assert_allclose(quarter.colour[10:], 0.75 * before.colour[4::5], atol=1e-6)
    assert not passage.at(0).colour[8:10].any()
    assert not quarter.log_opacity.any()
