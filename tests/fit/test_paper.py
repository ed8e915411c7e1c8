"""Fake quantisation: the values that a decoder will get, and a gradient straight through."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from gsvrcodec.fit.paper import fake_quantiser
from gsvrcodec.model.gop import Gop
from gsvrcodec.model.quantise import PAPER_BITS, dequantised
from tests import making

either_library = pytest.mark.parametrize("xp", [np, torch], ids=["numpy", "torch"])


def assert_as_decoded(gop: Gop, bits: dict[str, int], xp: Any, *, ties: float) -> None:
    """The fake values are a decoder's, but for a share of ties that fall to the other side."""
    fake = fake_quantiser(bits, xp)({n: xp.asarray(getattr(gop, n)) for n in Gop.__slots__})
    real = dequantised(gop, bits)
    for name in Gop.__slots__:
        ours, theirs = np.asarray(fake[name]), getattr(real, name)
        assert ours.shape == theirs.shape
        if not theirs.size:
            continue
        span = float(np.ptp(np.mod(getattr(gop, name), np.pi) if name == "rotation" else theirs))
        if name not in bits:
            np.testing.assert_array_equal(ours, getattr(gop, name))
            continue
        difference = np.abs(ours - theirs)
        step = span / ((1 << bits[name]) - 1)
        assert difference.max() <= 1.01 * step + 1e-6, name
        assert (difference > 0.05 * step + 2e-6).mean() <= ties, name


class TestValues:
    @either_library
    def test_as_a_decoder_sees_them(self, xp: Any) -> None:
        gop = making.random_gop(np.random.default_rng(1), gaussians=500)
        gop.rotation[:] = np.random.default_rng(2).uniform(-9, 9, 500)
        assert_as_decoded(gop, dict(PAPER_BITS), xp, ties=0.03)

    @either_library
    @given(
        seed=st.integers(0, 99),
        gaussians=st.integers(1, 40),
        bits=st.integers(1, 16),
        grid=st.sampled_from([(0, 0, 0), (1, 1, 1), (4, 3, 5)]),
    )
    def test_any_bits(
        self, seed: int, gaussians: int, bits: int, grid: tuple[int, int, int], xp: Any
    ) -> None:
        gop = making.random_gop(np.random.default_rng(seed), gaussians, grid)
        every = dict.fromkeys(Gop.__slots__, bits)
        assert_as_decoded(gop, every, xp, ties=1.0 if bits > 10 else 0.2)

    def test_equal_values_stay(self) -> None:
        values = {"colour": np.full((9, 3), 0.3, "f4"), "indicator": np.zeros(9, "f4")}
        out = fake_quantiser({"colour": 10, "indicator": 6}, np)(values)
        for name, value in values.items():
            np.testing.assert_allclose(out[name], value, rtol=1e-6, atol=1e-6)

    def test_the_span_is_a_component_s_own(self) -> None:
        values = np.array([[0.0, 0.0], [1.0, 1000.0], [0.4, 0.0]], "f4")
        out = fake_quantiser({"position": 8}, np)({"position": values})["position"]
        np.testing.assert_allclose(out[:, 0], values[:, 0], atol=0.5 / 255, rtol=0)


def test_rotation_is_turned_by_half_circles_only() -> None:
    angles = np.array([-7.0, -0.1, 0.0, 1.0, 3.2, 100.0], "f4")
    out = fake_quantiser({"rotation": 16}, np)({"rotation": angles})["rotation"]
    turns = (angles - out) / math.pi
    np.testing.assert_allclose(turns, turns.round(), atol=1e-4, rtol=0)
