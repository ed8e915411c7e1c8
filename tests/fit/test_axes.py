"""The axes that positions move along."""

from __future__ import annotations

import math

import numpy as np

from gsvrcodec.fit.adam import axes_of
from gsvrcodec.model.gop import Float32Array

SIZE = (40, 30)
HALF = np.array([20.0, 15.0], "f4")


def offsets(
    log_scale: list[list[float]], rotation: list[float], steps: list[list[float]]
) -> Float32Array:
    """Pixels that steps along the axes move by, (N, 2)."""
    tensors = {"log_scale": np.array(log_scale, "f4"), "rotation": np.array(rotation, "f4")}
    moved = axes_of(tensors, SIZE, np) @ np.array(steps, "f4")[:, :, None]
    pixels: Float32Array = moved[:, :, 0] * HALF
    return pixels


def test_by_hand() -> None:
    """Of scales 1 and 4 px the mean is 2 px; the first axis of the second Gaussian points down."""
    shapes = [[0.0, math.log(4)], [math.log(4), 0.0]], [0.0, math.pi / 2]
    found = offsets(*shapes, [[1.0, 0.5], [1.0, 0.0]])
    np.testing.assert_allclose(found, [[0.5, 1.0], [0.0, 2.0]], atol=1e-6)


def test_axes_are_not_too_long_or_short() -> None:
    found = offsets([[-9.0, 9.0]], [0.0], [[1.0, 1.0]])
    np.testing.assert_allclose(found, [[0.3, 3.0]], rtol=1e-6)
