"""Which tiles the steps of a fit look at."""

from __future__ import annotations

import numpy as np
import pytest

from gsvrcodec.fit.tiles import Tiles
from gsvrcodec.fit.tuned import TILES
from gsvrcodec.render.backend import TILE

SIZE = (1000, 500)  # 4 tiles across, 8 down


def tiles(seed: int = 0) -> Tiles:
    """Much happens in the upper left corner."""
    rng = np.random.default_rng(seed)
    position = rng.uniform(-1, 1, (500, 2)).astype(np.float32)
    worth = rng.uniform(0, 1, 500) * np.where(position.sum(1) < -0.5, 1000, 1)
    return Tiles(SIZE, position, worth)


def test_shares() -> None:
    shares = tiles().shares
    assert shares.shape == (32,)
    assert shares.mean() == pytest.approx(TILES.mean, abs=0.02)
    assert shares.min() >= TILES.least
    assert shares.max() == shares[0] == 1
    assert shares[-1] < 0.5


def test_the_mean_of_weights_is_one() -> None:
    own = tiles()
    weights = np.stack([own.at(step) for step in range(1, 1001)])
    assert weights.shape == (1000, 8, 4)
    assert weights.dtype == np.float32
    np.testing.assert_allclose(weights.mean(0), 1, atol=0.01)
    np.testing.assert_allclose((weights > 0).mean((1, 2)), TILES.mean, atol=0.25)
    assert (weights[:, 0, 0] == 1).all()
    np.testing.assert_array_equal(weights[6], own.at(7))


@pytest.mark.parametrize("size", [(8, 8), TILE, (257, 65)])
def test_small_frames(size: tuple[int, int]) -> None:
    own = Tiles(size, np.array([[-1, 1], [1, -1], [7, 0]], np.float32), np.array([1.0, 1, 0]))
    assert own.at(1).shape == (-(-size[1] // TILE[1]), -(-size[0] // TILE[0]))
    assert own.shares.max() == 1


def test_nothing_to_win() -> None:
    own = Tiles(SIZE, np.zeros((0, 2), np.float32), np.zeros(0))
    np.testing.assert_allclose(own.shares, TILES.mean, atol=1e-3)
