"""Where the source moves, and Gaussians that have no motion elsewhere."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from gsvrcodec.fit.fitting import Allowance, fit_gop
from gsvrcodec.fit.footage import Frames
from gsvrcodec.fit.moving import OverTime, to_be_static
from gsvrcodec.fit.parameters import MOTION, Parameters
from gsvrcodec.fit.predicted import LastFrame, fit_predicted
from gsvrcodec.fit.recipe import Deform, FitOptions
from gsvrcodec.fit.relocate import relocate
from gsvrcodec.fit.start import content_aware
from gsvrcodec.fit.target import Slope, bit_worth
from gsvrcodec.fit.tuned import MOVING
from gsvrcodec.model.gop import Gop
from gsvrcodec.model.prediction import Look, last_look
from tests.fit.anchored import key, predicted
from tests.fit.synthetic import BACKEND, footage, moving_texture, times

SIZE = (160, 96)
WORTH = MOVING.predicted_bits * bit_worth(1.0)


def film(frames: int = 6, step: float = 4.0, noise: float = 0.0, first: int = 0) -> Frames:
    """A textured square passes over the left half of a texture that stands still."""
    rng = np.random.default_rng(0)
    shots = moving_texture(1, (0, 0), SIZE).repeat(frames, axis=0)
    square = 255 - shots[0, 8:32, 100:124]
    for number, shot in enumerate(shots, first):
        x = 4 + round(step * number)
        shot[36:60, x : x + 24] = square
    noisy = shots + rng.normal(0, noise, shots.shape) if noise else shots
    return np.clip(noisy, 0, 255).astype(np.uint8)


def stands_still(gop: Gop) -> np.ndarray:
    """Which Gaussians look the same at all times."""
    moves = gop.linear.any(axis=1) | gop.quadratic.any(axis=1)
    return np.asarray((gop.indicator == 1) & ~moves)


class TestMoving:
    @pytest.mark.parametrize("noise", [0.0, 1.0])
    def test_it_is_where_something_passes(self, noise: float) -> None:
        where = OverTime(film(noise=noise)).moving(WORTH)
        assert where.shape == (96, 160)
        assert where[40:56, 8:44].mean() > 0.9
        assert not where[:, 64:].any()
        assert not where[72:].any()

    def test_less_moves_where_motion_has_to_save_more(self) -> None:
        frames = moving_texture(6, (0.2, 0), SIZE)
        shares = [OverTime(frames).moving(factor * WORTH).mean() for factor in (0.25, 4, 25)]
        assert shares[0] > 0.9
        assert shares[0] > shares[1] > shares[2]

    def test_a_single_frame_stands_still(self) -> None:
        assert not OverTime(film(1)).moving(1.0).any()


def test_gaussians_stand_still_where_their_boxes_do() -> None:
    """By hand: small ones here and there, one over all, one beyond the frame."""
    where = np.zeros((50, 100), np.bool_)
    where[:, :40] = True  # less than half
    position = np.array([[-0.5, 0], [0.5, 0], [0, 0], [3, 0], [-0.22, 0]], np.float32)
    log_scale = np.log(np.array([[2, 4], [2, 4], [90, 90], [1, 1], [8, 1]], np.float32))
    rotation = np.array([0, 1, 0, 0, np.pi / 2], np.float32)  # the last is narrow along x
    hidden = np.zeros((5, 3), np.float32), np.zeros(5, np.float32)
    look = Look(position, log_scale, rotation, *hidden)
    assert to_be_static(look, where).tolist() == [False, True, True, True, False]
    look.rotation[-1] = 0  # it reaches from 23 to 55 px: half of it
    assert not to_be_static(look, where)[-1]
    assert to_be_static(look[:0], where).shape == (0,)


class TestChanged:
    def test_noise_alone_is_no_change(self) -> None:
        frames = film(7, 0.0, noise=3.0)
        assert OverTime(frames[1:]).changed(frames[0], WORTH).mean() < 0.01

    def test_what_goes_by_between_two_gops_is_seen(self) -> None:
        """Nothing moves within the GOP, but the square was elsewhere in the frame before."""
        frames, before = film(step=0.0, noise=1.0), film(1, step=20.0, first=1)[0]
        assert not OverTime(frames).moving(WORTH).any()
        where = OverTime(frames).changed(before, WORTH)
        assert where[40:56, 6:20].mean() > 0.9
        assert where[40:56, 30:46].mean() > 0.9
        assert not where[:, 64:].any()
        assert not where[72:].any()


class TestStand:
    @pytest.mark.parametrize("make", [key, predicted])
    def test_steps_and_values(self, make: Callable[[], Parameters]) -> None:
        parameters = make()
        still = np.arange(28) % 3 == 0
        parameters.make_static(np.arange(28), still)
        np.testing.assert_array_equal(stands_still(parameters.gop()), still)
        gradients = {name: np.ones_like(tensor) for name, tensor in parameters.raw.items()}
        parameters.hold(gradients)
        for name, gradient in gradients.items():
            expected = still if name in (*MOTION, "indicator") else np.zeros(28, np.bool_)
            if name not in ("xy", "xt", "yt"):
                held = (gradient.reshape(28, -1) == 0).all(axis=1)
                np.testing.assert_array_equal(held, expected)

    def test_it_follows_the_order_and_can_end(self) -> None:
        parameters = key()
        still = np.arange(28) % 3 == 0
        parameters.make_static(np.arange(28), still)
        order = np.random.default_rng(0).permutation(28)
        parameters.rearrange(order)
        np.testing.assert_array_equal(stands_still(parameters.gop()), still[order])
        at = int(np.flatnonzero(still[order])[0])
        parameters.make_static(np.array([at]), np.array([False]))
        assert parameters.gop().indicator[at] < 1

    def test_without_polynomials_there_is_nothing_to_hold(self) -> None:
        parameters = predicted("triplane")
        before = parameters.gop()
        parameters.make_static(np.arange(28), np.ones(28, np.bool_))
        np.testing.assert_array_equal(parameters.gop().indicator, before.indicator)


def test_relocated_gaussians_stand_still_where_nothing_moves() -> None:
    frames = moving_texture(2, (0, 0), (96, 64))
    parameters = Parameters(start(frames, 300), "hybrid", BACKEND)
    parameters.raw["linear"] += 0.1
    where = np.zeros((64, 96), np.bool_)
    where[:, :48] = True
    args = frames, times(2), (96, 64), np.random.default_rng(1), 0.3
    _, moved = relocate(parameters, *args, moving=where)
    gop = parameters.gop()
    x = gop.position[:, 0]
    left, right = moved & (x < -0.2), moved & (x > 0.2)  # they may start from another place
    assert not stands_still(gop)[left].any()
    assert stands_still(gop)[right].all()
    assert min(left.sum(), right.sum()) > 10
    assert not stands_still(gop)[~moved].any()


def start(frames: Frames, gaussians: int) -> Gop:
    """Gaussians to begin with."""
    rng = np.random.default_rng(0)
    return content_aware(footage(frames), gaussians, (6, 4, len(frames)), None, rng, BACKEND)


@pytest.mark.parametrize("deform", ["hybrid", "polynomial"])
def test_key_and_predicted_gops_move_where_the_source_does(deform: Deform) -> None:
    """What stands still is as good as what moves, and the square is followed."""
    grid = (0, 0, 0) if deform == "polynomial" else (8, 5, 6)
    how = grid, FitOptions(deform=deform), Allowance(300, None), BACKEND
    slope = Slope(1.0, 2000)
    fit = fit_gop(footage(film()), 500, *how, seed=(0,), slope=slope)
    shown = BACKEND.render(BACKEND.prepare(fit.gop), np.ones(1, np.float32), SIZE, SIZE)[0]
    reference = LastFrame(last_look(fit.gop, 6), shown, film()[-1], 1.0, fit.psnr)
    after = fit_predicted(footage(film(first=6)), reference, 500, *how, seed=(1,), slope=slope)
    assert after is not None
    assert after.anchor is not None
    assert (fit.gop.position[:, 0] > 0.1).any()
    for gop, psnr in ((fit.gop, fit.psnr), (after.anchor.gop(after.gop), after.psnr)):
        moves = gop.position[~stands_still(gop)]
        assert len(moves) > 20
        assert (moves[:, 0] > 0.1).mean() < 0.02
        assert psnr > 27
