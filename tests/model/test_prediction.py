"""Prediction: Gaussians go on from where and as they are drawn in the reference's last frame."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from typing import get_args

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
    change_units,
    first_look,
    last_look,
    look_at,
    start_of_motion,
)
from gsvrcodec.model.reconstruction import MOST_LOG_OPACITY, Blending
from gsvrcodec.render import render_frames
from tests.gops import make_carried, make_gop

SIZE = (48, 32)


def plain_look(gop: Gop, n: int, tau: float, blending: Blending) -> list[float]:
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
        + tau * float(gop.linear[n, i])
        + tau**2 * float(gop.quadratic[n, i])
        + offset[i]
        for i in range(2)
    ]
    scale = [float(value) for value in gop.log_scale[n]]
    if gx and float(gop.indicator[n]) != 1:
        scale = [math.log(max(math.exp(scale[i]) + offset[2 + i], 0.1)) for i in range(2)]
    rotation = float(gop.rotation[n]) + offset[4]
    colour = [float(value) for value in gop.colour[n]]
    opacity = float(gop.log_opacity[n])
    if blending == "sum":
        colour = [colour[i] + offset[5 + i] for i in range(3)]
    else:
        opacity = min(max(opacity + offset[5], -MOST_LOG_OPACITY), MOST_LOG_OPACITY)
    return [*place, *scale, rotation, *colour, opacity]


def rows(look: Look) -> np.ndarray:
    """One row of nine numbers a Gaussian."""
    single = [look.rotation[:, None], look.colour, look.log_opacity[:, None]]
    return np.concatenate([look.position, look.log_scale, *single], axis=1)


class TestLook:
    @pytest.mark.parametrize("grid", [(0, 0, 0), (4, 3, 5), (1, 1, 1)])
    @pytest.mark.parametrize("tau", [-1.0, 0.0, 0.3, 1.0])
    @pytest.mark.parametrize("blending", get_args(Blending))
    def test_equals_the_equations(
        self, grid: tuple[int, int, int], tau: float, blending: Blending
    ) -> None:
        gop = make_gop(40, grid, 0, blending)
        gop.indicator[::3] = 1
        expected = [plain_look(gop, n, tau, blending) for n in range(40)]
        found = rows(look_at(gop, tau, blending))
        assert found.dtype == np.float32
        np.testing.assert_allclose(found, expected, rtol=3e-7, atol=3e-7)

    def test_opacities_stay_within_their_bounds(self) -> None:
        gop = make_gop(40, (3, 2, 4))
        gop.xy[..., 5] = np.array([-1000, 0, 1000])
        gop.indicator[::3] = 1
        found = look_at(gop, 0.3).log_opacity
        assert (found.min(), found.max()) == (-MOST_LOG_OPACITY, MOST_LOG_OPACITY)
        np.testing.assert_array_equal(found[::3], gop.log_opacity[::3])

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
        ):
            np.testing.assert_array_equal(rows(found), rows(look_at(gop, tau)))


def carried_gop(gop: Gop, frames: tuple[int, int], mode: int = 0) -> Gop:
    """The GOP predicted from `gop` with one mode for all, and nothing new."""
    modes = np.full(len(gop), mode, np.uint8)
    return carry_over(gop, frames, make_carried(modes), make_gop(0))


def unit_of(look: Look, n: int) -> dict[str, float]:
    """What a stored change of 1 adds to a Gaussian, by the equations of the spec in binary64."""
    first, second = map(float, look.log_scale[n])
    area, shape, opacity = first + second, min(abs(first - second), 4), float(look.log_opacity[n])
    return {
        "position": math.exp((3 * area - 4 * shape - opacity) / 8),
        "log_scale": math.exp((-area - shape - opacity) / 8),
        "rotation": math.exp((area - 7 * shape) / 8),
        "colour": math.exp((-2 * area - opacity) / 8),
        "log_opacity": 1.0,
    }


class TestUnits:
    def test_equal_the_equations(self) -> None:
        look = last_look(make_gop(60, (3, 2, 4)), 5)
        look.log_scale[:20, 0] += 5  # slender beyond what counts
        look.log_opacity[20:40] -= 3
        units = change_units(look)
        for name in Look.__slots__:
            found = getattr(units, name).reshape(60, -1)
            assert found.dtype == np.float32
            wanted = np.array([unit_of(look, n)[name] for n in range(60)])
            np.testing.assert_allclose(found, wanted[:, None].repeat(found.shape[1], 1), rtol=1e-6)

    def test_a_round_opaque_gaussian_of_one_pixel_has_ones(self) -> None:
        one = Look(*(np.zeros((3, *s), np.float32) for s in ((2,), (2,), (), (3,), ())))
        for name in Look.__slots__:
            assert (getattr(change_units(one), name) == 1).all()


class TestCarryOver:
    @pytest.mark.parametrize("frames", [(5, 4), (5, 1), (1, 4)])
    def test_kept_gaussians_stand_as_the_last_frame_shows_them(
        self, frames: tuple[int, int]
    ) -> None:
        gop = make_gop(50, (3, 2, 4))
        end = np.array([1 if frames[0] > 1 else 0], np.float32)
        last = render_frames(gop, end, SIZE, SIZE).astype(int)
        following = carried_gop(gop, frames)
        for tau in (-1, 0, 1):
            found = render_frames(following, np.array([tau], np.float32), SIZE, SIZE)
            assert np.abs(found - last).max() <= 1

    def test_motion_begins_one_mean_frame_before_the_first_frame(self) -> None:
        assert start_of_motion(5) == -1.5
        assert start_of_motion(2) == -3
        assert start_of_motion(1) == -1

    @pytest.mark.parametrize("frames", [(5, 4), (5, 2), (5, 1), (1, 9)])
    def test_the_way_of_a_moved_gaussian_begins_in_the_last_frame_of_the_reference(
        self, frames: tuple[int, int]
    ) -> None:
        gop = make_gop(50, (3, 2, 4))
        following = carried_gop(gop, frames, MOVED)
        last = last_look(gop, frames[0]).position
        start = start_of_motion(frames[1])
        way = start * following.linear + start**2 * following.quadratic
        np.testing.assert_allclose(following.position + way, last, atol=1e-6)
        assert np.abs(way).max() > 0.01

    def test_a_steady_motion_goes_on_without_a_jump(self) -> None:
        """The motion of the reference, in the time of a GOP of another length, is the same way."""
        gop = make_gop(50)
        gop.quadratic[:] = 0
        carried = make_carried(np.full(50, MOVED, np.uint8))
        carried.linear[:] = gop.linear / 2  # frames are 2/4 apart in the reference, 2/2 here
        carried.quadratic[:] = 0
        following = carry_over(gop, (5, 3), carried, make_gop(0))
        for frame in range(3):
            tau = -1.0 + frame
            ahead = 1.5 + 0.5 * frame  # tau of the reference, if it went on
            np.testing.assert_allclose(
                look_at(following, tau).position, look_at(gop, ahead).position, atol=1e-6
            )

    def test_every_mode_in_the_order_of_the_reference(self) -> None:
        gop, new = make_gop(10, (3, 2, 4)), make_gop(4, (2, 2, 2), seed=5)
        mode = np.array([0, MOVED, CHANGED, MOVED | CHANGED, DROPPED] * 2, np.uint8)
        carried = make_carried(mode)
        assert carried.kept == 8
        whole = carry_over(gop, (3, 5), carried, new)
        look = last_look(gop, 3)
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
            unit = unit_of(look, n)
            change = unit["position"] * carried.position[changed] if kind & CHANGED else 0
            place = look.position[n] + change
            start = whole.position[at] - 1.5 * whole.linear[at] + 2.25 * whole.quadratic[at]
            np.testing.assert_allclose(start, place, atol=1e-6)
            for name in ("log_scale", "rotation", "colour", "log_opacity"):
                change = unit[name] * getattr(carried, name)[changed] if kind & CHANGED else 0
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
            carried.log_opacity[:] = -20
            carried.linear[:], carried.quadratic[:] = 1000, -1000
            new = replace(make_gop(0), xy=gop.xy, xt=gop.xt, yt=gop.yt)
            gop = carry_over(gop, (2, 2), carried, new)
            for attribute in ATTRIBUTES:
                values = getattr(gop, attribute.name)
                assert (values >= attribute.low).all()
                assert (values <= attribute.high).all()
        assert gop.log_scale.max() == 13
        assert gop.log_opacity.max() == -MOST_LOG_OPACITY

    def test_nothing_to_carry(self) -> None:
        none = make_gop(0)
        whole = carry_over(none, (3, 3), make_carried(np.zeros(0, np.uint8)), make_gop(3))
        assert len(whole) == 3
        assert len(carried_gop(make_gop(4), (3, 3), DROPPED)) == 0

    def test_modes_and_arrays_must_agree(self) -> None:
        gop, mode = (
            make_gop(6),
            np.array([0, MOVED, CHANGED, MOVED | CHANGED, DROPPED, 0], np.uint8),
        )
        carried = make_carried(mode)
        for other, message in (
            (replace(carried, mode=mode[1:]), "mode must have an entry"),
            (replace(carried, mode=mode & np.uint8(7 - MOVED)), "indicator must have an entry"),
            (replace(carried, mode=mode & np.uint8(7 - CHANGED)), "arrays of a look"),
            (replace(carried, linear=carried.linear[1:]), "indicator, linear and quadratic"),
        ):
            with pytest.raises(ValueError, match=message):
                carry_over(gop, (3, 3), other, make_gop(0))
