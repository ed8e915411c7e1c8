"""The quantiser."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from gsvrcodec.model.attributes import ATTRIBUTES, Attribute
from gsvrcodec.model.gop import Float32Array
from gsvrcodec.model.quantise import PAPER_BITS, Finer, Quantiser, values_of

VALUES = arrays(
    np.float32,
    st.integers(1, 40),
    elements=st.floats(-1000, 1000, width=32, allow_subnormal=False),
)

UNBOUNDED = Attribute(0, "any", 1, "gaussians", -np.inf, np.inf)


def values_of_codes(quantiser: Quantiser, codes: NDArray[np.uint16]) -> Float32Array:
    """Values of codes of one component."""
    return values_of(codes[None], [quantiser], UNBOUNDED)


class TestQuantiser:
    @given(values=VALUES, bits=st.integers(1, 16))
    def test_error_is_half_a_step_at_most(self, values: Float32Array, bits: int) -> None:
        quantiser = Quantiser.fit(values, bits)
        codes = quantiser.quantise(values)
        assert codes.dtype == np.uint16
        assert codes.max() < 2**bits
        error = np.abs(values_of_codes(quantiser, codes).astype(np.float64) - values)
        # Half a step, and what rounding the step and the result to float32 adds.
        assert error.max() <= 0.5 * quantiser.step + 2e-7 * max(np.abs(values).max(), 1e-30)

    @given(values=VALUES, bits=st.integers(1, 16))
    def test_codes_survive_their_values(self, values: Float32Array, bits: int) -> None:
        quantiser = Quantiser.fit(values, bits)
        codes = quantiser.quantise(values)
        if quantiser.step > 1e-6 * np.abs(values).max():
            np.testing.assert_array_equal(
                quantiser.quantise(values_of_codes(quantiser, codes)), codes
            )

    def test_values_are_as_in_the_spec(self) -> None:
        quantiser = Quantiser(13, np.float32(-0.1).item(), np.float32(0.3).item())
        code = 8191
        expected = np.float32(np.float64(quantiser.offset) + code * np.float64(quantiser.step))
        assert values_of_codes(quantiser, np.array([code], np.uint16))[0] == expected
        assert quantiser.last == pytest.approx(expected)

    def test_halves_go_to_even(self) -> None:
        codes = Quantiser(8, 0.0, 1.0).quantise(np.array([0.5, 1.5, 2.5, -9, 999], np.float32))
        assert codes.tolist() == [0, 2, 2, 0, 255]

    def test_equal_values_have_step_zero_and_come_back_exactly(self) -> None:
        values = np.full(5, 0.1, np.float32)
        quantiser = Quantiser.fit(values, 8)
        assert quantiser.step == 0
        np.testing.assert_array_equal(
            values_of_codes(quantiser, quantiser.quantise(values)), values
        )

    @pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
    def test_a_value_that_is_not_finite_fails(self, value: float) -> None:
        with pytest.raises(ValueError, match="not finite"):
            Quantiser.fit(np.array([0, value], np.float32), 8)


class TestSteps:
    BOUNDS = (-1024.0, 1024.0)

    @given(values=VALUES, step=st.floats(2**-4, 100.0))
    def test_values_are_whole_steps(self, values: Float32Array, step: float) -> None:
        quantiser = Quantiser.of_step(values, step, (-4096.0, 4096.0))
        stored = values_of_codes(quantiser, quantiser.quantise(values)).astype(np.float64)
        assert np.abs(stored - values).max() <= 0.501 * quantiser.step
        whole = stored / quantiser.step
        assert np.abs(whole - np.rint(whole)).max() < 1e-2

    def test_no_more_bits_than_the_values_need(self) -> None:
        values = np.array([-0.3, 0.2, 0.41], np.float32)
        quantiser = Quantiser.of_step(values, 0.1, self.BOUNDS)
        assert quantiser.bits == 3
        assert quantiser.offset == pytest.approx(-0.3)

    def test_outliers_are_clipped_where_16_bits_are_too_few(self) -> None:
        values = np.array([0.001, 0.002, 0.003, 900.0], np.float32)
        quantiser = Quantiser.of_step(values, 0.001, self.BOUNDS)
        stored = values_of_codes(quantiser, quantiser.quantise(values))
        assert quantiser.bits == 16
        np.testing.assert_allclose(stored[:3], values[:3], atol=1e-5)
        assert 30 < stored[3] < 66

    @pytest.mark.parametrize("values", [[-31.9, 0, 0.1], [12.9, 12.9], [-32, 12, 13]])
    def test_no_code_is_out_of_bounds(self, values: list[float]) -> None:
        wanted = np.array(values, np.float32)
        quantiser = Quantiser.of_step(wanted, 0.012, (-32.0, 13.0))
        assert quantiser.offset >= -32
        assert quantiser.last <= 13
        stored = values_of_codes(quantiser, quantiser.quantise(wanted))
        assert np.abs(stored - wanted).min() < 0.02

    def test_a_value_that_is_not_finite_fails(self) -> None:
        with pytest.raises(ValueError, match="not finite"):
            Quantiser.of_step(np.array([0, np.nan], np.float32), 1.0, self.BOUNDS)


def test_the_paper_s_bits() -> None:
    fine = {name for name, bits in PAPER_BITS.items() if bits == 16}
    assert fine == {"position", "colour", "xy", "xt", "yt"}
    # The publication's pictures are sums, without opacities.
    assert {attribute.name for attribute in ATTRIBUTES} - fine - {"log_opacity"} == {
        name for name, bits in PAPER_BITS.items() if bits == 8
    }


class TestValues:
    QUANTISERS = (Quantiser(16, -3.25, 0.1), Quantiser(9, 0.7, 1 / 3), Quantiser(1, 5.0, 0.0))

    @pytest.mark.parametrize("shape", [(0,), (1,), (40,), (3, 5)])
    def test_components_come_last(self, shape: tuple[int, ...]) -> None:
        codes = np.random.default_rng(0).integers(0, 512, (3, *shape)).astype(np.uint16)
        found = values_of(codes, self.QUANTISERS, UNBOUNDED)
        assert found.shape == (*shape, 3)
        for part, quantiser in enumerate(self.QUANTISERS):
            expected = (codes[part] * np.float64(quantiser.step) + quantiser.offset).astype("f4")
            np.testing.assert_array_equal(found[..., part], expected)
            one = values_of(codes[part : part + 1], [quantiser], UNBOUNDED)
            np.testing.assert_array_equal(one, expected)

    def test_finer_values_lie_in_the_middle_of_their_part_of_a_step(self) -> None:
        r = np.random.default_rng(0)
        codes = r.integers(0, 512, (3, 200)).astype(np.uint16)
        bits = np.arange(200, dtype=np.int8) % 9
        numbers = (r.integers(0, 256, (3, 200)) >> 8 - bits).astype(np.uint8)
        found = values_of(codes, self.QUANTISERS, UNBOUNDED, Finer(bits, numbers))
        steps, offsets = (
            [getattr(q, name) for q in self.QUANTISERS] for name in ("step", "offset")
        )
        place = codes - 0.5 + (numbers + 0.5) / 2.0**bits
        expected = place * np.array(steps)[:, None] + np.array(offsets)[:, None]
        np.testing.assert_allclose(found.T, expected, rtol=1e-7, atol=1e-7)
        base = values_of(codes, self.QUANTISERS, UNBOUNDED)
        np.testing.assert_array_equal(found[bits == 0], base[bits == 0])

    def test_rows_of_codes_may_lie_apart(self) -> None:
        codes = np.arange(60, dtype=np.uint16).reshape(3, 20)
        part = values_of(codes[:, :7], self.QUANTISERS, UNBOUNDED)
        np.testing.assert_array_equal(part, values_of(codes, self.QUANTISERS, UNBOUNDED)[:7])

    def test_values_stay_within_the_bounds_of_the_attribute(self) -> None:
        codes = np.array([[0, 100, 65535]], np.uint16)
        (opacity,) = (a for a in ATTRIBUTES if a.name == "log_opacity")
        found = values_of(codes, [Quantiser(16, -20.0, 0.2)], opacity)
        assert found.tolist() == [-12, 0, 12]
