"""Prediction: Gaussians go on from where and as they were drawn at the end of the reference."""

from __future__ import annotations

import math
from dataclasses import fields, replace

import numpy as np
import pytest

from gsvrcodec.model.attributes import ATTRIBUTES
from gsvrcodec.model.gop import Gop
from gsvrcodec.model.prediction import (
    CHANGED,
    DROPPED,
    MOVED,
    Look,
    carry_over,
    first_look,
    last_look,
    look_after,
    look_at,
)
from gsvrcodec.render import render_frames
from tests.gops import make_carried, make_gop

SIZE = (48, 32)


def plain_look(gop: Gop, n: int, tau: float, ahead: float) -> list[float]:
    """One Gaussian by the equations of the spec, number by number in binary64."""
    gx, gy, gt = gop.xy.shape[1], gop.xy.shape[0], gop.xt.shape[0]
    px, py = map(float, gop.position[n])
    offset = [0.0] * 8
    if gx:
        u = min(max((px + 1) / 2 * (gx - 1), 0), gx - 1)
        v = min(max((py + 1) / 2 * (gy - 1), 0), gy - 1)
        t = min(max((tau + 1) / 2 * (gt - 1), 0), gt - 1)

        def bilinear(grid: np.ndarray, y: float, x: float, k: int) -> float:
            i, j = math.floor(y), math.floor(x)
            below, right = min(i + 1, grid.shape[0] - 1), min(j + 1, grid.shape[1] - 1)
            top = (1 - (x - j)) * float(grid[i, j, k]) + (x - j) * float(grid[i, right, k])
            low = (1 - (x - j)) * float(grid[below, j, k])
            low += (x - j) * float(grid[below, right, k])
            return (1 - (y - i)) * top + (y - i) * low

        for k in range(8):
            field = bilinear(gop.xy, v, u, k) * bilinear(gop.xt, t, u, k)
            offset[k] = (1 - float(gop.indicator[n])) * field * bilinear(gop.yt, t, v, k)
    place = [
        float(gop.position[n, i])
        + (tau + ahead) * float(gop.linear[n, i])
        + (tau**2 + 2 * tau * ahead) * float(gop.quadratic[n, i])
        + offset[i]
        for i in range(2)
    ]
    scale = [float(value) for value in gop.log_scale[n]]
    if gx and float(gop.indicator[n]) != 1:
        scale = [math.log(max(math.exp(scale[i]) + offset[2 + i], 0.1)) for i in range(2)]
    rotation = float(gop.rotation[n]) + offset[4]
    colour = [float(gop.colour[n, i]) + offset[5 + i] for i in range(3)]
    return [*place, *scale, rotation, *colour]


def rows(look: Look) -> np.ndarray:
    """One row of eight numbers a Gaussian."""
    columns = [look.position, look.log_scale, look.rotation[:, None], look.colour]
    return np.concatenate(columns, axis=1)


class TestLook:
    @pytest.mark.parametrize("grid", [(0, 0, 0), (4, 3, 5), (1, 1, 1)])
    @pytest.mark.parametrize(("tau", "ahead"), [(-1.0, 0.0), (0.0, 0.0), (0.3, 0.1), (1.0, 0.5)])
    def test_equals_the_equations(
        self, grid: tuple[int, int, int], tau: float, ahead: float
    ) -> None:
        gop = make_gop(40, grid)
        gop.indicator[::3] = 1
        expected = [plain_look(gop, n, tau, ahead) for n in range(40)]
        found = rows(look_at(gop, tau, ahead))
        assert found.dtype == np.float32
        np.testing.assert_allclose(found, expected, rtol=3e-7, atol=3e-7)

    def test_shares_no_memory(self) -> None:
        gop = make_gop(5)
        look = look_at(gop, 0.0)
        for name in Look.__slots__:
            assert not np.shares_memory(getattr(look, name), getattr(gop, name))

    def test_first_and_last(self) -> None:
        gop = make_gop(5, (2, 2, 2))
        for found, tau in (
            (first_look(gop, 2), -1.0),
            (first_look(gop, 1), 0.0),
            (last_look(gop, 9), 1.0),
            (last_look(gop, 1), 0.0),
            (look_after(gop, 1), 0.0),
        ):
            np.testing.assert_array_equal(rows(found), rows(look_at(gop, tau)))
        after = look_at(gop, 1.0, 2 / 4)
        np.testing.assert_array_equal(rows(look_after(gop, 5)), rows(after))


def kept_gop(gop: Gop, frames: int, mode: int = 0) -> Gop:
    """The GOP predicted from `gop` with one mode for all, and nothing new."""
    modes = np.full(len(gop), mode, np.uint8)
    return carry_over(gop, frames, make_carried(modes), make_gop(0))


class TestCarryOver:
    def test_kept_gaussians_are_where_the_reference_was_heading(self) -> None:
        gop = make_gop(50)
        gop.quadratic[:] = 0
        # Frames are 0.5 apart in tau, so the next frame of the same motion is at 1.5.
        heading = render_frames(gop, np.array([1.5], np.float32), SIZE, SIZE)
        for mode in (0, MOVED):
            following = kept_gop(gop, 5, mode)
            found = render_frames(following, np.array([-1], np.float32), SIZE, SIZE)
            assert np.abs(found.astype(int) - heading).max() <= 1

    def test_a_curve_goes_on_in_its_last_direction(self) -> None:
        gop = make_gop(50)
        after = kept_gop(gop, 5).position.astype(np.float64)
        speed = gop.linear.astype(np.float64) + 2 * gop.quadratic
        last = gop.position.astype(np.float64) + gop.linear + gop.quadratic
        np.testing.assert_allclose(after, last + 0.5 * speed, atol=1e-6)

    def test_every_mode_in_the_order_of_the_reference(self) -> None:
        gop, new = make_gop(10, (3, 2, 4)), make_gop(4, (2, 2, 2), seed=5)
        mode = np.array([0, MOVED, CHANGED, MOVED | CHANGED, DROPPED] * 2, np.uint8)
        carried = make_carried(mode)
        assert carried.kept == 8
        whole = carry_over(gop, 3, carried, new)
        look = look_after(gop, 3)
        assert len(whole) == 8 + 4
        for field in fields(Gop):
            if field.name in ("xy", "xt", "yt"):
                assert getattr(whole, field.name) is getattr(new, field.name)
            else:
                tail = getattr(whole, field.name)[8:]
                np.testing.assert_array_equal(tail, getattr(new, field.name))
        at = changed = moved = 0
        for n, kind in enumerate(mode):
            if kind == DROPPED:
                continue
            linear = quadratic = np.zeros(2, np.float32)
            indicator = np.float32(1)
            if kind & MOVED:
                indicator = carried.indicator[moved]
                linear, quadratic = carried.linear[moved], carried.quadratic[moved]
                moved += 1
            place = look.position[n] + (carried.position[changed] if kind & CHANGED else 0)
            start = whole.position[at] - whole.linear[at] + whole.quadratic[at]
            np.testing.assert_allclose(start, place, atol=1e-6)
            for name in ("log_scale", "rotation", "colour"):
                change = getattr(carried, name)[changed] if kind & CHANGED else 0
                np.testing.assert_allclose(
                    getattr(whole, name)[at], getattr(look, name)[n] + change, atol=1e-6
                )
            assert whole.indicator[at] == indicator
            np.testing.assert_array_equal(whole.linear[at], linear)
            np.testing.assert_array_equal(whole.quadratic[at], quadratic)
            changed += bool(kind & CHANGED)
            at += 1
        assert (at, changed, moved) == (8, 4, 4)

    def test_values_stay_within_the_bounds_however_long_the_chain(self) -> None:
        gop = make_gop(6, (2, 2, 2))
        for name, value in (("linear", 1000), ("quadratic", 1000), ("xt", 1000), ("xy", -1000)):
            getattr(gop, name)[...] = value
        mode = np.full(6, MOVED | CHANGED, np.uint8)
        for _ in range(20):
            carried = make_carried(mode)
            for name, value in (("position", 900), ("log_scale", 40), ("rotation", 60)):
                getattr(carried, name)[...] = value
            carried.colour[:] = 60_000
            carried.linear[:], carried.quadratic[:] = 1000, -1000
            gop = carry_over(gop, 2, carried, replace(make_gop(0), xy=gop.xy, xt=gop.xt, yt=gop.yt))
            for attribute in ATTRIBUTES:
                values = getattr(gop, attribute.name)
                assert (values >= attribute.low).all()
                assert (values <= attribute.high).all()
        assert gop.log_scale.max() == 13

    def test_nothing_to_carry(self) -> None:
        none = make_gop(0)
        whole = carry_over(none, 3, make_carried(np.zeros(0, np.uint8)), make_gop(3))
        assert len(whole) == 3
        assert len(kept_gop(make_gop(4), 3, DROPPED)) == 0
