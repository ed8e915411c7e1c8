"""The order of Gaussians in a fit, and for rendering."""

from __future__ import annotations

import numpy as np
import pytest

from gsvrcodec.model.prediction import look_at
from gsvrcodec.model.pyramid import level_of
from gsvrcodec.render import render_frames
from gsvrcodec.render.order import arranged, drawing_order
from tests.render.examples import random_gop

SIZE = (67, 45)


@pytest.mark.parametrize("count", [0, 1, 7, 500])
@pytest.mark.parametrize("size", [(1, 1), (33, 7), (320, 180)], ids=str)
def test_is_a_permutation(count: int, size: tuple[int, int]) -> None:
    r = np.random.default_rng(count)
    position = r.uniform(-3, 3, (count, 2)).astype(np.float32)
    log_scale = r.uniform(-2, 5, (count, 2)).astype(np.float32)
    assert sorted(drawing_order(position, log_scale, size).tolist()) == list(range(count))


def test_level_by_level_and_tile_by_tile() -> None:
    r = np.random.default_rng(0)
    position = r.uniform(-1, 1, (800, 2)).astype(np.float32)
    log_scale = r.uniform(-1, 4, (800, 2)).astype(np.float32)
    order = drawing_order(position, log_scale, (128, 64))
    level = level_of(log_scale, 1.0)[order]
    assert len(np.unique(level)) > 2
    assert (np.diff(level) >= 0).all()
    column, row = ((position[order] + 1) / 2 * (4, 2)).astype(int).T
    for number in np.unique(level):
        tile = (4 * row + column)[level == number]
        assert (np.diff(tile) >= 0).all()


def test_equal_ones_keep_their_order() -> None:
    position, log_scale = np.zeros((9, 2), np.float32), np.zeros((9, 2), np.float32)
    assert drawing_order(position, log_scale, (64, 64)).tolist() == list(range(9))


def test_order_changes_no_picture() -> None:
    gop = random_gop(60)
    ordered = arranged(gop, SIZE)
    levels = level_of(ordered.log_scale, 1.0)
    assert (np.diff(levels) >= 0).all()
    assert len(set(levels.tolist())) > 2
    taus = np.array([0.3], np.float32)
    picture, same = (render_frames(g, taus, SIZE, SIZE).astype(int) for g in (gop, ordered))
    assert np.abs(picture - same).max() <= 1


def test_neighbours_in_the_picture_follow_each_other() -> None:
    gop = random_gop(3000)
    gop.log_scale[:] = 0
    gop.indicator[:] = 0
    way = np.abs(np.diff(arranged(gop, (1280, 720)).position, axis=0))
    assert np.median(way[:, 0]) < 0.05
    assert np.median(way[:, 1]) < 0.05


def test_order_of_gaussians_beyond_the_frame() -> None:
    gop = random_gop(200)
    gop.position[::2] *= 100
    assert sorted(arranged(gop, SIZE).position.tolist()) == sorted(gop.position.tolist())


def test_positions_that_are_no_numbers_do_no_harm() -> None:
    gop = random_gop(50)
    gop.position[::3] = [np.nan, np.inf]
    gop.log_scale[::4] = np.nan
    order = drawing_order(gop.position, gop.log_scale, SIZE)
    assert sorted(order.tolist()) == list(range(50))
    assert len(look_at(gop, 0.5).position) == 50


def test_still_gaussians_come_last() -> None:
    gop = random_gop(40)
    gop.indicator[::4] = 1
    gop.linear[::4] = gop.quadratic[::4] = 0
    gop.indicator[1] = 1  # its polynomial moves it
    ordered = arranged(gop, SIZE)
    still = (ordered.indicator == 1) & ~ordered.linear.any(axis=1)
    assert still[-10:].all()
    assert not still[:-10].any()
