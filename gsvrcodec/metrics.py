"""Quality metrics of pictures: PSNR, SSIM, MS-SSIM."""

from __future__ import annotations

from dataclasses import dataclass
from math import log10, prod

import cv2
import numpy as np
from numpy.typing import NDArray

#: PSNR of equal pictures, for which the formula is infinite, dB.
MAX_PSNR = 100.0

#: MS-SSIM in dB of equal pictures, for which the formula is infinite.
MAX_MS_SSIM_DB = 100.0

#: SSIM's constants for 8-bit samples, (0.01 * 255)^2 and (0.03 * 255)^2 (Wang et al., 2004).
_C1 = 6.5025
_C2 = 58.5225

#: SSIM's window: 11x11 samples, Gaussian of sigma 1.5.
_WINDOW = 11
_SIGMA = 1.5

#: Exponents of the five scales of MS-SSIM, finest first (Wang, Simoncelli and Bovik, 2003).
_SCALES = (0.0448, 0.2856, 0.3001, 0.2363, 0.1333)


@dataclass(frozen=True, slots=True)
class Similarity:
    """Structural similarity of two pictures; 1 = equal."""

    ssim: float | None  #: None = a side is shorter than SSIM's window of 11 pixels
    ms_ssim: float | None  #: None = a side is shorter than 11 pixels on the coarsest of five scales


def squared_error(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> float:
    """Return the mean squared error of two 8-bit arrays of one shape.

    Raises:
        ValueError: The shapes differ.
    """
    _check_shapes(a, b)
    difference = np.subtract(a, b, dtype=np.float64).ravel()
    return float(difference @ difference) / max(1, difference.size)


def psnr_of(mean_squared_error: float) -> float:
    """Return the PSNR of 8-bit samples for their mean squared error, dB; `MAX_PSNR` at most."""
    if mean_squared_error <= 0:
        return MAX_PSNR
    return min(MAX_PSNR, 10 * log10(255**2 / mean_squared_error))


def psnr(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> float:
    """Return the PSNR over all samples of two 8-bit arrays of one shape, dB."""
    return psnr_of(squared_error(a, b))


def ms_ssim_db(ms_ssim: float) -> float:
    """Return an MS-SSIM, at most 1, as -10 log10(1 - ms_ssim), dB; `MAX_MS_SSIM_DB` at most."""
    if ms_ssim >= 1:
        return MAX_MS_SSIM_DB
    return min(MAX_MS_SSIM_DB, -10 * log10(1 - ms_ssim))


def similarity(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> Similarity:
    """Return SSIM and MS-SSIM of the luma of two pictures.

    As published: a Gaussian window of 11x11 pixels, population variances, the mean over all
    positions of the window inside the picture. MS-SSIM has five scales, each half the size of the
    one before by the mean of 2x2 pixels; a negative mean structure of a scale counts as 0. Luma is
    0.299 R + 0.587 G + 0.114 B, not rounded.

    Args:
        a: (H, W, 3) uint8, red, green, blue.
        b: The other picture, of the same shape.

    Raises:
        ValueError: The shapes differ, or are not those of RGB pictures.
    """
    _check_shapes(a, b)
    if a.ndim != 3 or a.shape[2] != 3:
        raise ValueError(f"pictures of shape {a.shape} are not RGB")
    x, y = luma(a), luma(b)
    ssim: float | None = None
    structures: list[float] = []
    for scale in range(len(_SCALES)):
        if scale:
            x, y = _halved(x), _halved(y)
        if min(x.shape) < _WINDOW:
            return Similarity(ssim, None)
        mean, structure = _ssim(x, y)
        ssim = mean if ssim is None else ssim
        structures.append(structure if scale < len(_SCALES) - 1 else mean)
    ms_ssim = prod(max(0.0, s) ** e for s, e in zip(structures, _SCALES, strict=True))
    return Similarity(ssim, ms_ssim)


def _check_shapes(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> None:
    if a.shape != b.shape:
        raise ValueError(f"pictures of shape {a.shape} and {b.shape} cannot be compared")


def luma(rgb: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return 0.299 R + 0.587 G + 0.114 B of a picture (H, W, 3), (H, W), 8-bit codes."""
    return np.asarray(cv2.cvtColor(rgb.astype(np.float32), cv2.COLOR_RGB2GRAY), np.float32)


def _halved(x: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the means of 2x2 samples; an odd last row or column is dropped."""
    height, width = x.shape[0] // 2 * 2, x.shape[1] // 2 * 2
    x = x[:height, :width]
    return (x[::2, ::2] + x[1::2, ::2] + x[::2, 1::2] + x[1::2, 1::2]) * np.float32(0.25)


def _blurred(x: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the weighted means over all windows that lie inside the picture."""
    taps = cv2.getGaussianKernel(_WINDOW, _SIGMA, cv2.CV_32F)
    half = _WINDOW // 2
    means = np.asarray(cv2.sepFilter2D(x, cv2.CV_32F, taps, taps), np.float32)
    return means[half:-half, half:-half]


def _ssim(x: NDArray[np.float32], y: NDArray[np.float32]) -> tuple[float, float]:
    """Return the mean SSIM, and the mean of its contrast-structure term."""
    # Moments about a level near the mean, against cancellation in float32.
    level = np.float32((x.mean(dtype=np.float64) + y.mean(dtype=np.float64)) / 2)
    x, y = x - level, y - level
    mean_x, mean_y = _blurred(x), _blurred(y)
    products = mean_x * mean_y
    squares = mean_x * mean_x + mean_y * mean_y
    structure = (2 * (_blurred(x * y) - products) + _C2) / (_blurred(x * x + y * y) - squares + _C2)
    mean_x, mean_y = mean_x + level, mean_y + level
    luminance = (2 * mean_x * mean_y + _C1) / (mean_x * mean_x + mean_y * mean_y + _C1)
    ssim = np.mean(luminance * structure, dtype=np.float64)
    return float(ssim), float(np.mean(structure, dtype=np.float64))
