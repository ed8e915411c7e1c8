"""Relocation: the weakest go where the error is, and nothing else changes."""

from __future__ import annotations

import numpy as np
import pytest

from gsvrcodec.fit.footage import Frames
from gsvrcodec.fit.parameters import Parameters
from gsvrcodec.fit.recipe import Deform
from gsvrcodec.fit.relocate import effects, relocate, sums_at
from gsvrcodec.fit.start import content_aware
from gsvrcodec.fit.tuned import RELOCATION
from gsvrcodec.metrics import squared_error
from gsvrcodec.model.plate import Plate
from gsvrcodec.model.reconstruction import GROUND
from gsvrcodec.planes import avif
from gsvrcodec.render import render_frames
from tests.fit.synthetic import BACKEND, assert_finite, footage, moving_texture, times

SIZE = (96, 64)


def started(frames: Frames, gaussians: int, deform: Deform = "hybrid") -> Parameters:
    grid = (0, 0, 0) if deform == "polynomial" else (6, 4, len(frames))
    rng = np.random.default_rng(0)
    start = content_aware(footage(frames), gaussians, grid, None, rng, BACKEND)
    return Parameters(start, deform, BACKEND)


@pytest.mark.parametrize("deform", ["hybrid", "polynomial", "triplane"])
def test_the_weakest_move_to_the_error(deform: Deform) -> None:
    frames = moving_texture(3, (0, 0), SIZE)
    parameters = started(frames, 400, deform)
    parameters.raw["log_opacity"][:50] = -11  # they hardly show
    before = parameters.gop()
    shown = render_frames(before, times(3), SIZE, SIZE)
    # The picture is met everywhere but in its lower right.
    wanted = shown.astype(np.uint8)
    wanted[:, 40:, 60:] = 255 - wanted[:, 40:, 60:]
    order, moved = relocate(parameters, wanted, times(3), SIZE, np.random.default_rng(1), 0.1)
    after = parameters.gop()
    assert_finite(after)
    assert sorted(order) == list(range(400))
    assert moved.sum() == 40
    assert (order[moved] < 50).all()
    assert (after.log_opacity[moved] >= 0).all()
    assert (after.position[moved] > (0.2, 0.2)).mean() > 0.9
    for name in ("position", "colour", "log_opacity"):
        value = getattr(after, name)[~moved]
        np.testing.assert_array_equal(value, getattr(before, name)[order[~moved]])
    # Nothing changes but where the error was, and what comes there is of use.
    now = render_frames(after, times(3), SIZE, SIZE)
    differs = np.abs(now.astype(int) - shown)
    assert differs[:, :34, :54].max() <= 3
    before_it, after_it = (squared_error(one.astype(np.uint8), wanted) for one in (shown, now))
    assert after_it < 0.8 * before_it


def test_before_a_plate_they_go_where_it_is_hidden() -> None:
    """Its own errors, which are larger in all, are left to it."""
    plate, frames = a_plate_and_what_hides_it()
    backend = BACKEND.over(plate)
    start = content_aware(footage(frames), 200, (0, 0, 0), None, np.random.default_rng(0), backend)
    start.log_opacity[:] = -11  # the plate shows
    parameters = Parameters(start, "polynomial", backend)
    shown = backend.render(backend.prepare(start), times(3), SIZE, SIZE).astype(int)
    errors = np.square(shown - frames).sum(axis=-1)
    assert errors[:, 20:44, 30:66].sum() < errors.sum() / 2
    _, moved = relocate(parameters, frames, times(3), SIZE, np.random.default_rng(1), 0.5)
    x, y = ((parameters.gop().position[moved] + 1) / 2 * SIZE).T
    assert moved.sum() == 100
    assert ((x > 26) & (x < 70) & (y > 16) & (y < 48)).mean() > 0.9


def a_plate_and_what_hides_it() -> tuple[Plate, Frames]:
    """A plate that is coded badly, and a lighter box before it."""
    texture = moving_texture(1, (0, 0), SIZE)[0]
    plate = Plate(avif.decode(avif.encode(texture, 45), SIZE))
    frames = np.stack([texture] * 3)
    frames[:, 20:44, 30:66] = np.clip(plate.shown()[20:44, 30:66].astype(int) + 10, 0, 255)
    return plate, frames


def test_a_moved_gaussian_has_the_colour_of_its_pixel() -> None:
    frames = moving_texture(1, (0, 0), SIZE)
    parameters = started(frames, 400, "polynomial")
    _, moved = relocate(parameters, frames, times(1), SIZE, np.random.default_rng(1), 0.1)
    gop = parameters.gop()
    assert moved.sum() == 40
    x, y = np.floor((gop.position[moved] + 1) / 2 * SIZE).astype(int).T
    np.testing.assert_allclose(gop.colour[moved], frames[0, y, x] / 255, atol=1e-6)


@pytest.mark.parametrize("log_opacity", [-5.0, 0.0, 5.0])
def test_opacities_follow_the_weights_that_are_there(log_opacity: float) -> None:
    frames = moving_texture(1, (0, 0), SIZE)
    parameters = started(frames, 400, "polynomial")
    parameters.raw["log_opacity"][:] = log_opacity
    weights = BACKEND.sums(BACKEND.prepare(parameters.drawn()), 0.0, SIZE, SIZE)[..., 3] + GROUND
    _, moved = relocate(parameters, frames, times(1), SIZE, np.random.default_rng(1), 0.1)
    gop = parameters.gop()
    x, y = np.floor((gop.position[moved] + 1) / 2 * SIZE).astype(int).T
    expected = np.log(np.maximum(RELOCATION.weight * weights[y, x], 1))
    np.testing.assert_allclose(gop.log_opacity[moved], expected, atol=1e-5)
    if log_opacity:  # at 0 weights are about 1
        assert expected.any() == (log_opacity > 0)


def test_a_moved_gaussian_follows_its_neighbours() -> None:
    frames = moving_texture(2, (0, 0), SIZE)
    parameters = started(frames, 200, "polynomial")
    parameters.raw["linear"][:] = 0.25
    _, moved = relocate(parameters, frames, times(2), SIZE, np.random.default_rng(1), 0.1)
    gop = parameters.gop()
    np.testing.assert_allclose(gop.linear[moved], 0.25)
    # The places were picked where the neighbours are at -1 or 1, inside the frame then.
    places = np.stack([gop.position[moved] + tau * gop.linear[moved] for tau in (-1, 1)])
    assert (np.abs(places) <= 1).all(axis=2).any(axis=0).all()


@pytest.mark.parametrize("gaussians", [1, 9, 5000])
def test_any_number(gaussians: int) -> None:
    frames = moving_texture(1, (0, 0), (40, 30))
    parameters = started(frames, gaussians)
    _, moved = relocate(parameters, frames, times(1), (40, 30), np.random.default_rng(1), 0.1)
    assert moved.sum() == gaussians // 10
    assert_finite(parameters.gop())


def test_more_gaussians_come_where_the_error_is() -> None:
    frames = moving_texture(2, (0, 0), (40, 30))
    parameters = started(frames, 100)
    before = parameters.gop()
    args = frames, times(2), (40, 30), np.random.default_rng(1), 0.1
    order, new = relocate(parameters, *args, more=30)
    after = parameters.gop()
    assert len(after) == 130
    assert new.sum() == 40
    assert (after.log_opacity[new] >= 0).all()
    assert len(set(order[~new])) == 90
    np.testing.assert_array_equal(after.position[~new], before.position[order[~new]])
    np.testing.assert_array_equal(after.colour[~new], before.colour[order[~new]])
    assert_finite(after)


def test_the_weakest_leave() -> None:
    frames = moving_texture(2, (0, 0), (40, 30))
    parameters = started(frames, 300)
    parameters.raw["log_opacity"][20:50] = -11
    before = parameters.gop()
    pictures = sums_at(before, times(2), (40, 30), (40, 30), BACKEND)
    found = effects(before, pictures, (40, 30), BACKEND)
    args = frames, times(2), (40, 30), np.random.default_rng(1), 0.1
    order, new = relocate(parameters, *args, more=-30)
    after = parameters.gop()
    assert len(after) == 270
    assert new.sum() == 30
    left = np.setdiff1d(np.arange(300), order)
    assert found[left].max() <= found[order].min()
    assert ((left >= 20) & (left < 50)).mean() > 0.8
    np.testing.assert_array_equal(after.position[~new], before.position[order[~new]])
