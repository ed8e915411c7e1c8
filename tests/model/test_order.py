"""The order of Gaussians in a file."""

from __future__ import annotations

import numpy as np
import pytest

from gsvrcodec.model.order import strip_order


@pytest.mark.parametrize("count", [0, 1, 2, 3, 4, 5, 99, 100, 101])
def test_is_a_permutation(count: int) -> None:
    position = np.random.default_rng(count).uniform(-1, 1, (count, 2)).astype(np.float32)
    assert sorted(strip_order(position).tolist()) == list(range(count))


def test_rows_rise_in_x_and_follow_each_other_in_y() -> None:
    position = np.random.default_rng(0).uniform(-1, 1, (100, 2)).astype(np.float32)
    rows = position[strip_order(position)].reshape(10, 10, 2)
    assert (np.diff(rows[..., 0], axis=1) > 0).all()
    assert (rows[:-1, :, 1].max(axis=1) < rows[1:, :, 1].min(axis=1)).all()


def test_equal_positions_keep_their_order() -> None:
    assert strip_order(np.zeros((9, 2), np.float32)).tolist() == list(range(9))
