"""Variance along quadratic paths: what moves smoothly leaves none of it."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pytest

from gsvrcodec.encoder.paths import Paths
from gsvrcodec.encoder.tuned import PATHS
from gsvrcodec.fit.motion import Image
from tests.fit.synthetic import moving_texture


def followed(frames: Iterable[Image], flow: tuple[float, float] = (0, 0)) -> list[list[float]]:
    """What is known of the GOPs that end with each frame, if all moves by `flow`, px a frame."""
    paths, known = Paths(), []
    for number, frame in enumerate(frames):
        field = np.broadcast_to(np.array(flow, np.float32), (*frame.shape[:2], 2))
        known.append([*paths.add(frame, np.ascontiguousarray(field) if number else None)])
    return known


def test_of_which_gops_it_is_told() -> None:
    known = followed(moving_texture(140, (0, 0), (64, 48)))
    for number, values in enumerate(known, 1):
        fitting = [length for length in PATHS.lengths if length <= number]
        assert len(values) == (0 if number % PATHS.grid else len(fitting))
    assert {length % PATHS.grid for length in PATHS.lengths} == {0}
    assert {length - 1 for length in PATHS.lengths} <= set(PATHS.looks)


def test_what_follows_the_flow_leaves_nothing() -> None:
    frames = moving_texture(24, (2, 1), (320, 180))
    still, moving = followed(frames)[-1], followed(frames, (2, 1))[-1]
    assert max(moving) < 0.02 * min(still)
    assert max(followed(frames[:1].repeat(24, axis=0))[-1]) < 1e-6


def test_places_are_quadratic() -> None:
    """What goes back and forth is followed within a half of its way alone."""
    texture = moving_texture(1, (0, 0), (320, 180))[0]
    places = [min(number, 16 - number) * 2 for number in range(16)]
    frames = [np.roll(texture, place, axis=1) for place in places]
    paths = Paths()
    for number, frame in enumerate(frames):
        step = 0 if not number else places[number] - places[number - 1]
        flow = np.full((180, 320, 2), (step, 0), np.float32)
        known = paths.add(frame, flow if number else None)
    by_length = dict(zip(PATHS.lengths, known, strict=False))
    assert 10 * by_length[6] < by_length[16]


def test_noise_has_the_same_variance_in_gops_of_any_length() -> None:
    rng = np.random.default_rng(0)
    noise = rng.normal(128, 10, (64, 180, 320, 1)).round().astype(np.uint8).repeat(3, axis=3)
    known = followed(noise)[-1]
    assert max(known) < 1.15 * min(known)
    assert known == pytest.approx([np.mean(known)] * len(known), rel=0.1)


@pytest.mark.parametrize("size", [(1, 1), (5, 3), (3, 200), (320, 180)])
def test_any_size(size: tuple[int, int]) -> None:
    width, height = size
    frames = np.random.default_rng(0).integers(0, 256, (8, height, width, 3), np.uint8)
    (*_, known) = followed(frames)
    assert len(known) == 3
    assert all(value > 0 for value in known)
