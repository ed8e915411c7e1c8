"""The quantiser."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from gsvrcodec.model.attributes import ATTRIBUTES
from gsvrcodec.model.gop import Float32Array
from gsvrcodec.model.quantise import BITS, Quantiser

VALUES = arrays(
    np.float32,
    st.integers(1, 40),
    elements=st.floats(-1000, 1000, width=32, allow_subnormal=False),
)


class TestQuantiser:
    @given(values=VALUES, bits=st.integers(1, 16))
    def test_error_is_half_a_step_at_most(self, values: Float32Array, bits: int) -> None:
        quantiser = Quantiser.fit(values, bits)
        codes = quantiser.quantise(values)
        assert codes.dtype == np.uint16
        assert codes.max() < 2**bits
        error = np.abs(quantiser.dequantise(codes).astype(np.float64) - values)
        # Half a step, and what rounding the step and the result to float32 adds.
        assert error.max() <= 0.5 * quantiser.step + 2e-7 * max(np.abs(values).max(), 1e-30)

    @given(values=VALUES, bits=st.integers(1, 16))
    def test_codes_survive_their_values(self, values: Float32Array, bits: int) -> None:
        quantiser = Quantiser.fit(values, bits)
        codes = quantiser.quantise(values)
        if quantiser.step > 1e-6 * np.abs(values).max():
            np.testing.assert_array_equal(quantiser.quantise(quantiser.dequantise(codes)), codes)

    def test_values_are_as_in_the_spec(self) -> None:
        quantiser = Quantiser(13, np.float32(-0.1).item(), np.float32(0.3).item())
        code = 8191
        expected = np.float32(np.float64(quantiser.offset) + code * np.float64(quantiser.step))
        assert quantiser.dequantise(np.array([code], np.uint16))[0] == expected
        assert quantiser.last == pytest.approx(expected)

    def test_halves_go_to_even(self) -> None:
        codes = Quantiser(8, 0.0, 1.0).quantise(np.array([0.5, 1.5, 2.5, -9, 999], np.float32))
        assert codes.tolist() == [0, 2, 2, 0, 255]

    def test_equal_values_have_step_zero_and_come_back_exactly(self) -> None:
        values = np.full(5, 0.1, np.float32)
        quantiser = Quantiser.fit(values, 8)
        assert quantiser.step == 0
        np.testing.assert_array_equal(quantiser.dequantise(quantiser.quantise(values)), values)

    @pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
    def test_a_value_that_is_not_finite_fails(self, value: float) -> None:
        with pytest.raises(ValueError, match="not finite"):
            Quantiser.fit(np.array([0, value], np.float32), 8)


class TestBits:
    @pytest.mark.parametrize("profile", BITS)
    def test_every_attribute_has_bits(self, profile: str) -> None:
        assert set(BITS[profile]) == {attribute.name for attribute in ATTRIBUTES}
        assert all(1 <= bits <= 16 for bits in BITS[profile].values())
