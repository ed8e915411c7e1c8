"""Frames to be fitted."""

from __future__ import annotations

import numpy as np

from gsvrcodec.fit.footage import Footage


def test_size_and_pixels() -> None:
    frames = np.zeros((4, 6, 9, 3), np.uint8)
    footage = Footage(frames, np.linspace(-1, 1, 4, dtype=np.float32))
    assert footage.size == (9, 6)
    assert footage.pixels == 4 * 9 * 6
