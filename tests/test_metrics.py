"""PSNR and structural similarity against their definitions and published code."""

from __future__ import annotations

from math import log10

import cv2
import numpy as np
import pytest

from gsvrcodec.metrics import (
    MAX_MS_SSIM_DB,
    MAX_PSNR,
    Similarity,
    ms_ssim_db,
    psnr,
    psnr_of,
    similarity,
    squared_error,
)
from gsvrcodec.video import open_video
from tests import making


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


def test_ms_ssim_in_decibels() -> None:
    assert [ms_ssim_db(value) for value in (0.0, 0.9, 0.999)] == pytest.approx([0, 10, 30])
    assert ms_ssim_db(1.0) == ms_ssim_db(1 - 1e-12) == MAX_MS_SSIM_DB


def test_other_shapes_fail() -> None:
    with pytest.raises(ValueError, match=r"\(2, 2, 3\) and \(2, 3, 3\)"):
        psnr(np.zeros((2, 2, 3), np.uint8), np.zeros((2, 3, 3), np.uint8))


@pytest.fixture(scope="module")
def frames() -> list[making.Rgb]:
    """Frames 0, 1 and 12 of the small Bunny, 320x180."""
    with open_video(making.BUNNY_SMALL, frames=13) as video:
        frames = [frame.rgb for frame in video]
    return [frames[0], frames[1], frames[12]]


class TestSimilarity:
    def test_published_code(self, frames: list[making.Rgb]) -> None:
        # skimage.metrics.structural_similarity(x, y, gaussian_weights=True, sigma=1.5,
        # use_sample_covariance=False, data_range=255) of scikit-image 0.25.2, float64 luma.
        first, second, far = frames
        assert similarity(first, second).ssim == pytest.approx(0.8808455440, abs=2e-7)
        assert similarity(first, far).ssim == pytest.approx(0.3177893973, abs=2e-7)
        # pytorch_msssim 1.0.0, ms_ssim(x, y, data_range=255), float64 luma; 176 rows stay even.
        assert similarity(first[:176], second[:176]).ms_ssim == pytest.approx(0.9059, abs=5e-5)

    def test_agrees_with_opencv(self, frames: list[making.Rgb]) -> None:
        first, second = (f.astype(np.float32) for f in frames[:2])
        measure = cv2.quality.QualitySSIM.create(cv2.cvtColor(first, cv2.COLOR_RGB2GRAY))
        measure.compute(cv2.cvtColor(second, cv2.COLOR_RGB2GRAY))
        windows = np.asarray(measure.getQualityMap())
        inside = float(windows[5:-5, 5:-5].mean())  # windows that lie wholly inside the picture
        assert similarity(frames[0], frames[1]).ssim == pytest.approx(inside, abs=1e-5)

    def test_definition(self) -> None:
        rng = np.random.default_rng(5)
        a, b = rng.integers(0, 256, (2, 14, 13, 3), np.uint8)
        x, y = (picture @ np.array([0.299, 0.587, 0.114]) for picture in (a, b))
        offset = np.arange(-5, 6)
        window = np.exp(-(offset**2) / (2 * 1.5**2))
        weights = np.outer(window, window) / window.sum() ** 2
        values = []
        for row in range(4):
            for column in range(3):
                p, q = (z[row : row + 11, column : column + 11] for z in (x, y))
                m, n = (weights * p).sum(), (weights * q).sum()
                s, t = (weights * p * p).sum() - m * m, (weights * q * q).sum() - n * n
                both = (weights * p * q).sum() - m * n
                light = (2 * m * n + 2.55**2) / (m * m + n * n + 2.55**2)
                values.append(light * (2 * both + 7.65**2) / (s + t + 7.65**2))
        assert similarity(a, b).ssim == pytest.approx(np.mean(values), abs=1e-6)

    def test_equal_pictures(self, frames: list[making.Rgb]) -> None:
        assert similarity(frames[0], frames[0]) == Similarity(1.0, 1.0)

    def test_symmetric(self, frames: list[making.Rgb]) -> None:
        there, back = similarity(*frames[:2]), similarity(*frames[1::-1])
        assert there.ssim == pytest.approx(back.ssim, abs=1e-9)
        assert there.ms_ssim == pytest.approx(back.ms_ssim, abs=1e-9)

    def test_flat_pictures_differ_in_luminance_alone(self) -> None:
        a, b = np.full((176, 180, 3), 100, np.uint8), np.full((176, 180, 3), 120, np.uint8)
        light = (2 * 100 * 120 + 2.55**2) / (100**2 + 120**2 + 2.55**2)
        found = similarity(a, b)
        assert found.ssim == pytest.approx(light, abs=1e-6)
        assert found.ms_ssim == pytest.approx(light**0.1333, abs=1e-6)

    def test_negative_is_no_complex_number(self) -> None:
        a = np.indices((176, 176)).sum(0).astype(np.uint8)[..., None].repeat(3, 2) % 2 * 255
        found = similarity(a, 255 - a)
        assert found.ssim is not None
        assert found.ssim < 0
        assert found.ms_ssim == 0.0

    @pytest.mark.parametrize(
        ("size", "known"), [((10, 200), (False, False)), ((175, 200), (True, False))]
    )
    def test_small_pictures_have_none(
        self, size: tuple[int, int], known: tuple[bool, bool]
    ) -> None:
        found = similarity(*np.zeros((2, *size, 3), np.uint8))
        assert (found.ssim is not None, found.ms_ssim is not None) == known

    def test_other_shapes_fail(self) -> None:
        with pytest.raises(ValueError, match="cannot be compared"):
            similarity(np.zeros((20, 20, 3), np.uint8), np.zeros((20, 21, 3), np.uint8))
        with pytest.raises(ValueError, match="not RGB"):
            similarity(np.zeros((20, 20), np.uint8), np.zeros((20, 20), np.uint8))
