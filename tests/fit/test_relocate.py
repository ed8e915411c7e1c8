"""Relocation: the weakest go where the error is, and nothing else changes."""

from __future__ import annotations

import numpy as np
import pytest

from gsvrcodec.fit.field import Field
from gsvrcodec.fit.footage import Frames
from gsvrcodec.fit.options import Deform
from gsvrcodec.fit.relocate import relocate
from gsvrcodec.fit.start import content_aware
from gsvrcodec.render import render_frames
from tests.fit.synthetic import BACKEND, assert_finite, footage, moving_texture, times

SIZE = (96, 64)


def started(frames: Frames, gaussians: int, deform: Deform = "hybrid") -> Field:
    grid = (0, 0, 0) if deform == "polynomial" else (6, 4, len(frames))
    rng = np.random.default_rng(0)
    start = content_aware(footage(frames), gaussians, grid, None, rng, BACKEND)
    return Field(start, deform, BACKEND)


@pytest.mark.parametrize("deform", ["hybrid", "polynomial", "triplane"])
def test_the_weakest_move_to_the_error(deform: Deform) -> None:
    frames = moving_texture(3, (0, 0), SIZE)
    field = started(frames, 400, deform)
    field.raw["colour"].data[:50] *= 1e-4
    before = field.gop()
    shown = render_frames(before, times(3), SIZE, SIZE)
    # The picture is met everywhere but in its lower right.
    wanted = shown.astype(np.uint8)
    wanted[:, 40:, 60:] = 255 - wanted[:, 40:, 60:]
    order, moved = relocate(field, wanted, times(3), SIZE, np.random.default_rng(1), 0.1)
    after = field.gop()
    assert_finite(after)
    assert sorted(order) == list(range(400))
    assert moved.sum() == 40
    assert (order[moved] < 50).all()
    assert not after.colour[moved].any()
    assert (after.position[moved] > (0.2, 0.2)).mean() > 0.9
    np.testing.assert_array_equal(after.position[~moved], before.position[order[~moved]])
    # What moved is black, and what it left was next to nothing.
    differs = np.abs(render_frames(after, times(3), SIZE, SIZE).astype(int) - shown)
    assert differs.max() <= 3


def test_a_moved_gaussian_follows_its_neighbours() -> None:
    frames = moving_texture(2, (0, 0), SIZE)
    field = started(frames, 200, "polynomial")
    field.raw["linear"].data[:] = 0.25
    _, moved = relocate(field, frames, times(2), SIZE, np.random.default_rng(1), 0.1)
    gop = field.gop()
    np.testing.assert_allclose(gop.linear[moved], 0.25)
    # The places were picked where the neighbours are at -1 or 1, inside the frame then.
    places = np.stack([gop.position[moved] + tau * gop.linear[moved] for tau in (-1, 1)])
    assert (np.abs(places) <= 1).all(axis=2).any(axis=0).all()


@pytest.mark.parametrize("gaussians", [1, 9, 5000])
def test_any_number(gaussians: int) -> None:
    frames = moving_texture(1, (0, 0), (40, 30))
    field = started(frames, gaussians)
    _, moved = relocate(field, frames, times(1), (40, 30), np.random.default_rng(1), 0.1)
    assert moved.sum() == gaussians // 10
    assert_finite(field.gop())


def test_more_gaussians_come_where_the_error_is() -> None:
    frames = moving_texture(2, (0, 0), (40, 30))
    field = started(frames, 100)
    before = field.gop()
    args = frames, times(2), (40, 30), np.random.default_rng(1), 0.1
    order, new = relocate(field, *args, more=30)
    after = field.gop()
    assert len(after) == 130
    assert new.sum() == 40
    assert not after.colour[new].any()
    assert len(set(order[~new])) == 90
    np.testing.assert_array_equal(after.position[~new], before.position[order[~new]])
    np.testing.assert_array_equal(after.colour[~new], before.colour[order[~new]])
    assert_finite(after)


def test_the_weakest_leave() -> None:
    frames = moving_texture(2, (0, 0), (40, 30))
    field = started(frames, 100)
    field.raw["colour"].data[20:50] *= 1e-4
    before = field.gop()
    args = frames, times(2), (40, 30), np.random.default_rng(1), 0.1
    order, new = relocate(field, *args, more=-30)
    after = field.gop()
    assert len(after) == 70
    assert new.sum() == 10
    assert sorted(order) == [*range(20), *range(50, 100)]
    np.testing.assert_array_equal(after.position[~new], before.position[order[~new]])
