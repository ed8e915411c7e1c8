"""What is not worth its bits: motion that hardly moves, changes that hardly change."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gsvrcodec.fit.parameters import LOOK
from gsvrcodec.fit.precision import (
    equal_slope_steps,
    with_static,
    with_unchanged,
    with_usual_opacity,
)
from gsvrcodec.model.gop import Gop
from gsvrcodec.model.quantise import dequantised
from tests.render.examples import random_gop

FEW = 0.01


def _sensitivities(gop: Gop) -> Gop:
    return Gop(**{n: np.full_like(getattr(gop, n), 1e6) for n in Gop.__slots__})


def _some_slow() -> Gop:
    gop = random_gop(40)
    gop.linear[:] += 0.5 * np.sign(gop.linear)
    gop.indicator[:20] = 1 - FEW
    gop.linear[:20] = gop.quadratic[:20] = FEW
    return gop


def test_the_slow_become_static_and_the_others_do_not_change() -> None:
    gop = _some_slow()
    stored = with_static(gop, [_sensitivities(gop)], 1.0)
    assert (stored.indicator[:20] == 1).all()
    assert not stored.linear[:20].any()
    assert not stored.quadratic[:20].any()
    for name in Gop.__slots__:
        np.testing.assert_array_equal(getattr(stored, name)[20:40], getattr(gop, name)[20:40])


def test_the_worst_state_counts() -> None:
    """Gaussians outside of the frame change nothing there, but they would if they came back."""
    gop = _some_slow()
    nothing = Gop(**{n: np.zeros_like(getattr(gop, n)) for n in Gop.__slots__})
    assert not with_static(gop, [nothing], 1.0).linear.any()
    moving = with_static(gop, [nothing, _sensitivities(gop)], 1.0).linear.any(axis=1)
    assert moving.tolist() == [False] * 20 + [True] * 20


@pytest.mark.parametrize(("qscale", "static"), [(0.1, 0), (1.0, 20), (1e6, 40)])
def test_more_where_steps_are_coarse(qscale: float, static: int) -> None:
    gop = _some_slow()
    assert (~with_static(gop, [_sensitivities(gop)], qscale).linear.any(axis=1)).sum() == static


@pytest.mark.parametrize("qscale", [0.1, 0.37, 1.0, 3.3])
def test_they_are_exactly_static_once_decoded(qscale: float) -> None:
    gop = _some_slow()
    found = _sensitivities(gop)
    gop = replace(gop, linear=gop.linear * 0.3)
    decoded = dequantised(with_static(gop, [found], 1.0), equal_slope_steps(found, qscale))
    assert (decoded.indicator[:20] == 1).all()
    assert not decoded.linear[:20].any()
    assert not decoded.quadratic[:20].any()


class TestUsualOpacity:
    NEW = np.arange(40) < 30

    def gop(self) -> Gop:
        """Ten opacities near 1 at either end, others far from it."""
        gop = random_gop(40)
        gop.log_opacity[:] = 2.0
        gop.log_opacity[:10] = gop.log_opacity[30:] = FEW
        return gop

    def test_new_ones_near_1_have_none(self) -> None:
        gop = self.gop()
        stored = with_usual_opacity(gop, self.NEW, _sensitivities(gop), 1.0)
        assert not stored.log_opacity[:10].any()
        np.testing.assert_array_equal(stored.log_opacity[10:], gop.log_opacity[10:])
        assert stored.log_opacity.dtype == np.float32
        for name in {*Gop.__slots__} - {"log_opacity"}:
            assert getattr(stored, name) is getattr(gop, name)

    @pytest.mark.parametrize(("qscale", "usual"), [(0.01, 0), (1.0, 10), (1e3, 30)])
    def test_more_where_bits_are_dear(self, qscale: float, usual: int) -> None:
        gop = self.gop()
        stored = with_usual_opacity(gop, self.NEW, _sensitivities(gop), qscale)
        assert (stored.log_opacity == 0).sum() == usual


class TestUnchanged:
    """Ten Gaussians change much, ten a little, ten not at all; the last ten are new."""

    CARRIED = np.arange(40) < 30

    def changed(self) -> Gop:
        gop = random_gop(40)
        for name in LOOK:
            getattr(gop, name)[10:20] *= 1e-4
            getattr(gop, name)[20:30] = 0
            getattr(gop, name)[35:] *= 1e-4
        return gop

    def test_what_hardly_changes_is_undone(self) -> None:
        gop = self.changed()
        found = _sensitivities(gop)
        stored = with_unchanged(gop, self.CARRIED, [found], equal_slope_steps(found, 1.0), 1.0)
        for name in LOOK:
            before, after = getattr(gop, name), getattr(stored, name)
            np.testing.assert_array_equal(after[:10], before[:10])
            assert not after[10:30].any()
            np.testing.assert_array_equal(after[30:], before[30:])
        for name in {*Gop.__slots__} - {*LOOK}:
            assert getattr(stored, name) is getattr(gop, name)
        assert gop.colour[10:20].all()

    @pytest.mark.parametrize(("qscale", "changed"), [(0.001, 20), (1.0, 10), (1e6, 0)])
    def test_more_where_bits_are_dear(self, qscale: float, changed: int) -> None:
        gop = self.changed()
        found = _sensitivities(gop)
        steps = equal_slope_steps(found, qscale)
        stored = with_unchanged(gop, self.CARRIED, [found], steps, qscale)
        assert stored.colour[:30].any(axis=1).sum() == changed
        assert stored.colour[30:].any(axis=1).all()

    def test_what_cannot_be_seen_is_undone(self) -> None:
        gop = self.changed()
        found = _sensitivities(gop)
        steps = equal_slope_steps(found, 1.0)
        for name in LOOK:
            getattr(found, name)[:5] = 0
        stored = with_unchanged(gop, self.CARRIED, [found], steps, 1.0)
        assert not stored.colour[:5].any()
        assert stored.colour[5:10].all()

    def test_what_would_show_without_the_change_stays(self) -> None:
        """As where a change has hidden a Gaussian: then it is sensitive in another state alone."""
        gop = self.changed()
        hidden, shown = _sensitivities(gop), _sensitivities(gop)
        steps = equal_slope_steps(shown, 1.0)
        for name in LOOK:
            getattr(hidden, name)[:10] = 0
        for states in ([hidden, shown], [shown, hidden]):
            stored = with_unchanged(gop, self.CARRIED, states, steps, 1.0)
            assert stored.colour[:10].all()
            assert not stored.colour[10:30].any()
