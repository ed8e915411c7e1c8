"""Gaussians whose motion is not worth its bits are static, in the file too."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gsvrcodec.fit.precision import equal_slope_steps
from gsvrcodec.fit.static import with_static
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
    stored = with_static(gop, _sensitivities(gop), 1.0)
    assert (stored.indicator[:20] == 1).all()
    assert not stored.linear[:20].any()
    assert not stored.quadratic[:20].any()
    for name in Gop.__slots__:
        np.testing.assert_array_equal(getattr(stored, name)[20:40], getattr(gop, name)[20:40])


@pytest.mark.parametrize(("qscale", "static"), [(0.1, 0), (1.0, 20), (1e6, 40)])
def test_more_where_steps_are_coarse(qscale: float, static: int) -> None:
    gop = _some_slow()
    assert (~with_static(gop, _sensitivities(gop), qscale).linear.any(axis=1)).sum() == static


@pytest.mark.parametrize("qscale", [0.1, 0.37, 1.0, 3.3])
def test_they_are_exactly_static_once_decoded(qscale: float) -> None:
    gop = _some_slow()
    found = _sensitivities(gop)
    gop = replace(gop, linear=gop.linear * 0.3)
    decoded = dequantised(with_static(gop, found, 1.0), equal_slope_steps(found, qscale))
    assert (decoded.indicator[:20] == 1).all()
    assert not decoded.linear[:20].any()
    assert not decoded.quadratic[:20].any()
