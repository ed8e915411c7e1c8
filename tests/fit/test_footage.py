"""Frames to be fitted."""

from __future__ import annotations

import numpy as np
import pytest

from gsvrcodec.fit.footage import Footage, some_frames


def test_size_and_pixels() -> None:
    frames = np.zeros((4, 6, 9, 3), np.uint8)
    footage = Footage(frames, np.linspace(-1, 1, 4, dtype=np.float32))
    assert footage.size == (9, 6)
    assert footage.pixels == 4 * 9 * 6


@pytest.mark.parametrize(
    ("frames", "count", "chosen"), [(9, 3, [0, 4, 8]), (2, 8, [0, 1]), (1, 3, [0])]
)
def test_some_frames(frames: int, count: int, chosen: list[int]) -> None:
    assert some_frames(frames, count).tolist() == chosen
