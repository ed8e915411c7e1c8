"""What a GOP stores of its reference: the mode of each Gaussian follows from what is rounded."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gsvrcodec.encoder.gop import carried_of, new_of
from gsvrcodec.fit.fitting import Fit
from gsvrcodec.fit.footage import Footage
from gsvrcodec.fit.parameters import LOOK, Anchor
from gsvrcodec.model.attributes import ATTRIBUTES
from gsvrcodec.model.gop import Gop
from gsvrcodec.model.prediction import (
    CHANGED,
    DROPPED,
    MOVED,
    Carried,
    Look,
    carry_over,
    last_look,
    start_of_motion,
)
from gsvrcodec.model.quantise import dequantised, short_step
from tests.gops import make_gop

STEPS = {a.name: (short_step(0.01),) * a.components for a in ATTRIBUTES}
FRAMES = 4


def predicted(source: list[int], kept: list[int], reference: Gop) -> Fit:
    """A fit whose Gaussians do not change and do not move; those of source -1 are new."""
    count = len(source)
    none = make_gop(count, (2, 2, 2))
    for name in (*LOOK, "linear", "quadratic"):
        getattr(none, name)[:] = 0
    none.indicator[:] = 1
    numbers = np.array(source, np.intp)
    look = last_look(reference, FRAMES)
    looks = {name: getattr(look, name)[numbers].copy() for name in LOOK}
    for values in looks.values():
        values[numbers < 0] = 0
    anchor = Anchor(start_of_motion(FRAMES), Look(**looks), numbers)
    stays = np.zeros(len(reference), np.bool_)
    stays[kept] = True
    footage = Footage(np.zeros((FRAMES, 8, 8, 3), np.uint8), np.zeros(FRAMES, np.float32))
    return Fit(none, 30.0, 1.0, None, footage, anchor, stays)


def stored(fit: Fit, gop: Gop) -> Carried:
    carried = carried_of(fit, gop, STEPS)
    assert carried is not None
    return carried


class TestModes:
    REFERENCE = make_gop(8)

    def test_a_key_gop_has_none(self) -> None:
        fit = replace(predicted([], [], self.REFERENCE), anchor=None, kept=None)
        gop = make_gop(5)
        assert carried_of(fit, gop, STEPS) is None
        assert new_of(fit, gop) is gop

    def test_every_kind(self) -> None:
        """Gaussian 0 is kept, 1 carried without change, 2 moved, 4 changed, 6 both."""
        fit = predicted([6, -1, 2, 4, 1, -1], [0], self.REFERENCE)
        gop = fit.gop
        gop.linear[[0, 2]] = [[0.3, 0], [0, -0.2]]
        gop.indicator[0] = 0.5
        gop.colour[[0, 3]] = [[0.1, 0, 0], [0, 0.2, 0]]
        found = stored(fit, gop)
        gone = DROPPED
        expected = [0, 0, MOVED, gone, CHANGED, gone, MOVED | CHANGED, gone]
        assert found.mode.tolist() == expected
        # In the order of the reference.
        np.testing.assert_array_equal(
            found.colour[:, :2], np.array([[0, 0.2], [0.1, 0]], np.float32)
        )
        np.testing.assert_array_equal(found.linear, np.array([[0, -0.2], [0.3, 0]], np.float32))
        np.testing.assert_array_equal(found.indicator, np.array([1, 0.5], np.float32))
        assert found.kept == 5

    @pytest.mark.parametrize("name", LOOK)
    def test_a_change_counts_from_half_a_step_on(self, name: str) -> None:
        fit = predicted([0, 1], [], self.REFERENCE)
        step = STEPS[name][0]
        getattr(fit.gop, name)[0, ...] = 0.49 * step
        getattr(fit.gop, name)[1, ...] = 0.51 * step
        found = stored(fit, fit.gop)
        assert found.mode[:2].tolist() == [0, CHANGED]
        assert len(found.position) == 1

    @pytest.mark.parametrize(
        ("name", "value"), [("linear", 0.0), ("quadratic", 0), ("indicator", 1)]
    )
    def test_a_motion_counts_from_half_a_step_on(self, name: str, value: float) -> None:
        fit = predicted([0, 1], [], self.REFERENCE)
        getattr(fit.gop, name)[0, ...] = value - 0.49 * STEPS[name][0]
        getattr(fit.gop, name)[1, ...] = value - 0.51 * STEPS[name][0]
        found = stored(fit, fit.gop)
        assert found.mode[:2].tolist() == [0, MOVED]
        assert len(found.linear) == 1

    def test_half_a_turn_is_no_change(self) -> None:
        fit = predicted([0, 1, 2], [], self.REFERENCE)
        assert fit.anchor is not None
        units = fit.anchor.units.rotation
        fit.gop.rotation[:] = np.array([np.pi, -5 * np.pi + 0.001, 3 * np.pi + 0.4]) / units
        found = stored(fit, fit.gop)
        assert found.mode[:3].tolist() == [0, 0, CHANGED]
        np.testing.assert_allclose(found.rotation, 0.4 / units[2:], rtol=1e-4)

    def test_nothing_is_carried_on(self) -> None:
        fit = predicted([-1, -1], [2, 3], self.REFERENCE)
        found = stored(fit, fit.gop)
        assert found.mode.tolist() == [DROPPED] * 2 + [0] * 2 + [DROPPED] * 4
        assert found.position.shape == (0, 2)
        assert found.indicator.shape == (0,)


def test_a_decoder_gets_the_gaussians_of_the_fit() -> None:
    """Kept ones, then those of the fit as the rounded values say, each of them once."""
    reference = make_gop(40, (3, 2, 4))
    draw = np.random.default_rng(2)
    source = draw.permutation(40)[:20]
    kept = np.setdiff1d(np.arange(40), source)[:15]
    fit = predicted([*source.tolist(), -1, -1], kept.tolist(), reference)
    changes: dict[str, Any] = {
        name: draw.normal(0, 0.02, getattr(fit.gop, name).shape).astype(np.float32)
        for name in (*LOOK, "linear", "quadratic")
    }
    gop = replace(fit.gop, **changes)
    rounded = dequantised(gop, STEPS)
    carried = stored(fit, gop)
    exact = Carried(
        carried.mode,
        **{
            name: np.round(getattr(carried, name) / STEPS[name][0]).astype(np.float32)
            * np.float32(STEPS[name][0])
            for name in Carried.__slots__[1:]
        },
    )
    whole = carry_over(reference, (FRAMES, FRAMES), exact, new_of(fit, rounded))
    drawn = fit.drawn(rounded)
    order = np.argsort(source)
    for name in ("position", "log_scale", "colour", "linear", "quadratic"):
        look = last_look(reference, FRAMES)
        still = getattr(look, name)[kept] if name in LOOK else np.zeros((15, 2), np.float32)
        numbers = np.concatenate([kept, np.sort(source)])
        expected = np.concatenate([still, getattr(drawn, name)[:20][order]])
        expected = expected[np.argsort(numbers)]
        np.testing.assert_allclose(getattr(whole, name)[:35], expected, atol=1e-5)
        np.testing.assert_array_equal(getattr(whole, name)[35:], getattr(rounded, name)[20:])
