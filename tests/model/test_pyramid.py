"""Which level a Gaussian is drawn on, and Gaussians put in order of their levels."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gsvrcodec.model.pyramid import by_level, level_of, level_size, zoom
from gsvrcodec.model.reconstruction import LEVELS
from gsvrcodec.render import render_frames
from tests.render.examples import random_gop


@pytest.mark.parametrize("level", range(LEVELS))
def test_a_gaussian_is_a_pixel_wide_on_its_level(level: int) -> None:
    bound = np.float32(math.log(2**level))
    below = np.nextafter(bound, np.float32(-9))
    log_scale = np.array([[bound, bound], [bound, 9], [9, bound], [below, 9]], np.float32)
    assert level_of(log_scale, 1.0).tolist() == [level] * 3 + [max(level - 1, 0)]


def test_levels_end() -> None:
    log_scale = np.array([[9, 9], [-9, 9], [np.nan, 0]], np.float32)
    huge, tiny, not_a_number = level_of(log_scale, 1.0).tolist()
    assert (huge, tiny) == (LEVELS - 1, 0)
    assert not_a_number in range(LEVELS)


def test_a_larger_frame_has_coarser_levels() -> None:
    log_scale = np.full((1, 2), math.log(3.0), np.float32)
    assert [level_of(log_scale, z)[0] for z in (0.25, 0.5, 1.0, 2.0, 100.0)] == [0, 0, 1, 2, 4]
    assert zoom((200, 50), (100, 100)) == 0.5


def test_sizes_are_rounded_up() -> None:
    assert [level_size((5, 1), level) for level in range(4)] == [(5, 1), (3, 1), (2, 1), (1, 1)]


def test_order_changes_no_picture() -> None:
    gop = random_gop(60)
    ordered = by_level(gop)
    levels = level_of(ordered.log_scale, 1.0)
    assert (np.diff(levels) >= 0).all()
    assert len(set(levels.tolist())) > 2
    taus = np.array([0.3], np.float32)
    picture, same = (render_frames(g, taus, (67, 45), (67, 45)).astype(int) for g in (gop, ordered))
    assert np.abs(picture - same).max() <= 1


def test_neighbours_in_the_picture_follow_each_other() -> None:
    gop = random_gop(3000)
    gop.log_scale[:] = 0
    gop.indicator[:] = 0
    way = np.abs(np.diff(by_level(gop).position, axis=0))
    assert np.median(way[:, 0]) < 0.05
    assert np.median(way[:, 1]) < 0.05


def test_order_of_gaussians_beyond_the_frame() -> None:
    gop = random_gop(200)
    gop.position[::2] *= 100
    assert sorted(by_level(gop).position.tolist()) == sorted(gop.position.tolist())


def test_still_gaussians_come_last() -> None:
    gop = random_gop(40)
    gop.indicator[::4] = 1
    gop.linear[::4] = gop.quadratic[::4] = 0
    gop.indicator[1] = 1  # its polynomial moves it
    ordered = by_level(gop)
    still = (ordered.indicator == 1) & ~ordered.linear.any(axis=1)
    assert still[-10:].all()
    assert not still[:-10].any()
