"""PSNR against its definition."""

from __future__ import annotations

from math import log10

import numpy as np
import pytest

from gsvrcodec.metrics import MAX_PSNR, psnr, psnr_of, squared_error


def test_known_values() -> None:
    black, grey = np.zeros((4, 5, 3), np.uint8), np.full((4, 5, 3), 10, np.uint8)
    assert squared_error(black, grey) == squared_error(grey, black) == 100.0
    assert psnr(black, grey) == pytest.approx(20 * log10(25.5))
    assert psnr(black, np.full_like(black, 255)) == 0.0


def test_equal_pictures_have_the_maximum() -> None:
    grey = np.full((4, 5, 3), 10, np.uint8)
    assert psnr(grey, grey) == psnr_of(0.0) == MAX_PSNR
    assert psnr_of(1e-12) == MAX_PSNR


def test_agrees_with_the_definition_on_noise() -> None:
    rng = np.random.default_rng(3)
    a, b = rng.integers(0, 256, (2, 90, 160, 3), np.uint8)
    error = ((a.astype(int) - b.astype(int)) ** 2).mean()
    assert psnr(a, b) == pytest.approx(10 * log10(255**2 / error), abs=1e-12)


def test_other_shapes_fail() -> None:
    with pytest.raises(ValueError, match=r"\(2, 2, 3\) and \(2, 3, 3\)"):
        psnr(np.zeros((2, 2, 3), np.uint8), np.zeros((2, 3, 3), np.uint8))
