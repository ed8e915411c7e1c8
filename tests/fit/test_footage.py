"""Frames to be fitted."""

from __future__ import annotations

import numpy as np

from gsvrcodec.fit.footage import Footage


def test_size_and_pixels() -> None:
    frames = np.zeros((4, 6, 9, 3), np.uint8)
    footage = Footage(frames, np.linspace(-1, 1, 4, dtype=np.float32))
    assert footage.size == (9, 6)
    assert footage.pixels == 4 * 9 * 6


def test_one_picture_of_many_frames() -> None:
    picture = Footage(np.zeros((1, 6, 9, 3), np.uint8), np.zeros(1, np.float32), shown=50)
    assert picture.pixels == 50 * 9 * 6
