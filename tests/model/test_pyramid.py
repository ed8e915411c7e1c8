"""Which level a Gaussian is drawn on, and how large levels are."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gsvrcodec.model.pyramid import level_of, level_size, zoom
from gsvrcodec.model.reconstruction import LEVELS


@pytest.mark.parametrize("level", range(LEVELS))
def test_a_gaussian_is_a_pixel_wide_on_its_level(level: int) -> None:
    bound = np.float32(math.log(2**level))
    below = np.nextafter(bound, np.float32(-9))
    log_scale = np.array([[bound, bound], [bound, 9], [9, bound], [below, 9]], np.float32)
    assert level_of(log_scale, 1.0).tolist() == [level] * 3 + [max(level - 1, 0)]


def test_levels_end() -> None:
    log_scale = np.array([[9, 9], [-9, 9], [np.nan, 0]], np.float32)
    huge, tiny, not_a_number = level_of(log_scale, 1.0).tolist()
    assert (huge, tiny) == (LEVELS - 1, 0)
    assert not_a_number in range(LEVELS)


def test_a_larger_frame_has_coarser_levels() -> None:
    log_scale = np.full((1, 2), math.log(3.0), np.float32)
    assert [level_of(log_scale, z)[0] for z in (0.25, 0.5, 1.0, 2.0, 100.0)] == [0, 0, 1, 2, 4]
    assert zoom((200, 50), (100, 100)) == 0.5


def test_sizes_are_rounded_up() -> None:
    assert [level_size((5, 1), level) for level in range(4)] == [(5, 1), (3, 1), (2, 1), (1, 1)]
