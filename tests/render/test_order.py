"""The order of Gaussians in a fit."""

from __future__ import annotations

import numpy as np
import pytest

from gsvrcodec.model.pyramid import level_of
from gsvrcodec.render.order import drawing_order


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
