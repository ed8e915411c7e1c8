"""Passage: the pictures between a GOP and the next that is predicted from it."""

from __future__ import annotations

import numpy as np
import pytest

from gsvrcodec.model.gop import Gop
from gsvrcodec.model.passage import Passage
from gsvrcodec.model.prediction import DROPPED, carry_over
from gsvrcodec.render import render_frames
from tests.gops import make_carried, make_gop, make_modes

SIZE = (48, 32)


def picture(gop: Gop, tau: float) -> np.ndarray:
    """One picture, as signed numbers."""
    (codes,) = render_frames(gop, np.array([tau], np.float32), SIZE, SIZE)
    return np.asarray(codes, int)


@pytest.mark.parametrize("grid", [(0, 0, 0), (3, 2, 4)])
@pytest.mark.parametrize("frames", [(4, 3), (1, 3), (4, 1), (1, 1)])
def test_begins_and_ends_with_the_frames(
    grid: tuple[int, int, int], frames: tuple[int, int]
) -> None:
    before = make_gop(60, grid)
    mode = make_modes(60)
    after = carry_over(before, frames, make_carried(mode), make_gop(20, grid, seed=3))
    passage = Passage.of(before, after, mode != DROPPED, frames)
    last = picture(before, 1 if frames[0] > 1 else 0)
    first = picture(after, -1 if frames[1] > 1 else 0)
    assert np.abs(last - first).max() > 20
    assert np.abs(picture(passage.at(0), 0) - last).max() <= 1
    assert np.abs(picture(passage.at(1), 0) - first).max() <= 1


def test_gaussians_go_in_a_straight_line() -> None:
    before = make_gop(10)
    mode = np.array([0, 1, 2, 3, DROPPED] * 2, np.uint8)
    after = carry_over(before, (3, 3), make_carried(mode), make_gop(2, seed=3))
    passage = Passage.of(before, after, mode != DROPPED, (3, 3))
    start, quarter, stop = (passage.at(weight) for weight in (0, 0.25, 1))
    assert len(quarter) == 8 + 2 + 2
    for name in ("position", "log_scale", "rotation", "colour"):
        mean = 0.75 * getattr(start, name).astype(float) + 0.25 * getattr(stop, name)
        np.testing.assert_allclose(getattr(quarter, name), mean, atol=1e-6)
    # New ones fade in at their place, dropped ones fade out at theirs.
    np.testing.assert_allclose(quarter.colour[8:10], 0.25 * after.colour[8:], atol=1e-6)
    np.testing.assert_allclose(quarter.colour[10:], 0.75 * before.colour[4::5], atol=1e-6)
    np.testing.assert_array_equal(start.position[8:], stop.position[8:])
