"""Temporal noise of still areas."""

from __future__ import annotations

import numpy as np
import pytest

from tests.benchmarks.still import noise, still_pixels, strip

RNG = np.random.default_rng(0)
FILM = RNG.normal(100, 3, (12, 40, 300)).astype(np.float32)
ALL = np.ones((40, 300), np.bool_)


class TestNoise:
    def test_the_source_itself(self) -> None:
        variance, *ratios = noise(FILM, FILM, ALL, [0, 4, 8])
        assert variance == pytest.approx(9, rel=0.2)
        assert ratios == [1, 1, 1]

    def test_a_still_picture_has_none(self) -> None:
        flat = np.full_like(FILM, 100)
        assert noise(FILM, flat, ALL, [0, 6])[1:] == (0, 0, 0)

    def test_jumps_from_gop_to_gop(self) -> None:
        jumping = 100 + 5 * (np.arange(12) // 4 % 2)[:, None, None] * np.ones_like(FILM)
        _, variance, within, between = noise(FILM, jumping.astype(np.float32), ALL, [0, 4, 8])
        assert variance > 0.4
        assert within == 0
        assert between is not None
        assert between > 1

    def test_one_gop(self) -> None:
        assert noise(FILM, FILM, ALL, [0])[3] is None

    def test_what_moves_does_not_count(self) -> None:
        moving = FILM.copy()
        moving[::2, :, :100] += 90
        still = ALL.copy()
        still[:, :100] = False
        assert noise(FILM, moving, still, [0])[1] == 1


def test_still_pixels() -> None:
    pictures = RNG.integers(95, 105, (12, 40, 60, 3)).astype(np.uint8)
    pictures[3, :, :20] += 100
    still = still_pixels(list(pictures))
    assert not still[:, :20].any()
    assert still[:, 30:].all()


def test_strip_is_of_still_pixels_and_has_both_films() -> None:
    still = ALL.copy()
    still[:, :60] = False
    decoded = np.zeros_like(FILM)
    picture = strip(FILM, decoded, still)
    assert picture.shape == (3 * (12 + 2 + 12), 600)
    assert picture[:36].mean() == pytest.approx(100, abs=2)
    assert not picture[42:].any()
