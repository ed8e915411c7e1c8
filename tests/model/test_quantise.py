"""The quantiser."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from gsvrcodec.model.attributes import ATTRIBUTES, Attribute
from gsvrcodec.model.gop import Float32Array
from gsvrcodec.model.quantise import (
    PAPER_BITS,
    Finer,
    Quantiser,
    short_step,
    step_number,
    step_of,
    values_of,
)

VALUES = arrays(
    np.float32,
    st.integers(1, 40),
    elements=st.floats(-1000, 1000, width=32, allow_subnormal=False),
)

WIDE = (-65536.0, 65536.0)
UNBOUNDED = Attribute(0, "any", 1, "gaussians", -np.inf, np.inf)


def values_of_codes(quantiser: Quantiser, codes: NDArray[np.uint16]) -> Float32Array:
    """Values of codes of one component."""
    return values_of(codes[None], [quantiser], UNBOUNDED)


class TestQuantiser:
    @given(values=VALUES, bits=st.integers(1, 16))
    def test_error_is_half_a_step_at_most(self, values: Float32Array, bits: int) -> None:
        quantiser = Quantiser.fit(values, bits, WIDE)
        codes = quantiser.quantise(values)
        assert codes.dtype == np.uint16
        assert codes.max() < 2**bits
        error = np.abs(values_of_codes(quantiser, codes).astype(np.float64) - values)
        # With a bit a value, two multiples of the step need not lie around all values.
        most = 0.5 if bits > 1 else 1.0
        # And what rounding the result to float32 adds.
        assert error.max() <= most * quantiser.step + 1e-7 * np.abs(values).max()

    @given(values=VALUES, bits=st.integers(2, 16))
    def test_steps_are_hardly_longer_than_the_bits_allow(
        self, values: Float32Array, bits: int
    ) -> None:
        span = float(values.max()) - float(values.min())
        finest = max(span / (2**bits - 2), np.abs(values).max() / 2**30)
        if span:
            assert Quantiser.fit(values, bits, WIDE).step <= finest * (1 + 2**-8)

    @given(values=VALUES, bits=st.integers(1, 16))
    def test_codes_survive_their_values(self, values: Float32Array, bits: int) -> None:
        quantiser = Quantiser.fit(values, bits, WIDE)
        codes = quantiser.quantise(values)
        if quantiser.step > 1e-6 * np.abs(values).max():
            np.testing.assert_array_equal(
                quantiser.quantise(values_of_codes(quantiser, codes)), codes
            )

    @pytest.mark.parametrize("bits", range(2, 17))
    def test_values_at_both_bounds_stay_within_them(self, bits: int) -> None:
        values = np.array([-12, 12, 5], np.float32)
        quantiser = Quantiser.fit(values, bits, (-12.0, 12.0))
        assert -12 <= quantiser.offset <= quantiser.last <= 12
        stored = values_of_codes(quantiser, quantiser.quantise(values))
        assert np.abs(stored - values).max() <= 1.5 * quantiser.step + 24 / 2**8
        assert abs(stored[2] - 5) <= 0.5 * quantiser.step

    def test_values_are_as_in_the_spec(self) -> None:
        quantiser = Quantiser(13, -(2**30) + 1, 257 / 2**20)
        code = 8191
        expected = np.float32((code - 2**30 + 1) * 257 / 2**20)
        assert values_of_codes(quantiser, np.array([code], np.uint16))[0] == expected
        assert np.float32(quantiser.last) == expected

    def test_halves_go_to_even(self) -> None:
        codes = Quantiser(8, 0, 1.0).quantise(np.array([0.5, 1.5, 2.5, -9, 999], np.float32))
        assert codes.tolist() == [0, 2, 2, 0, 255]

    @given(value=st.floats(-65536, 65536, width=32))
    @example(13.0)
    @example(-12.0)
    @example(2.0**-140)
    def test_equal_values_take_a_bit_and_come_back_exactly(self, value: float) -> None:
        values = np.full(5, value, np.float32)
        quantiser = Quantiser.fit(values, 8, WIDE)
        assert quantiser.bits == 1
        # No code is farther from 0 than the value, so that bounds hold for both.
        assert max(abs(quantiser.offset), abs(quantiser.last)) <= max(abs(value), 1)
        found = values_of_codes(quantiser, quantiser.quantise(values))
        np.testing.assert_array_equal(found, values if abs(value) > 2**-96 else 0 * values)
        assert step_of(step_number(quantiser.step)) == quantiser.step

    @pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
    def test_a_value_that_is_not_finite_fails(self, value: float) -> None:
        with pytest.raises(ValueError, match="not finite"):
            Quantiser.fit(np.array([0, value], np.float32), 8, WIDE)


class TestStepNumbers:
    def test_one_is_in_the_middle(self) -> None:
        assert step_number(1.0) == 32768
        steps = [step_of(number) for number in (0, 32769, 65535)]
        assert steps == [2.0**-128, 257 / 256, 511 * 2.0**119]

    @given(number=st.integers(0, 2**16 - 1))
    def test_all_are_steps(self, number: int) -> None:
        step = step_of(number)
        assert step_number(step) == number
        assert short_step(step) == step
        assert short_step(step * (1 + 2.0**-11)) == step

    @pytest.mark.parametrize("step", [0.0, -1.0, 1 / 3, 0.1, 2.0**-129, 2.0**128])
    def test_others_are_none(self, step: float) -> None:
        with pytest.raises(ValueError, match="no step of a quantiser"):
            step_number(step)

    @pytest.mark.parametrize(("step", "digits", "found"), [(0.3, 1, 0.25), (0.3, 3, 0.3125)])
    def test_short_ones_are_the_nearest(self, step: float, digits: int, found: float) -> None:
        assert short_step(step, digits) == found


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
        assert quantiser.offset == pytest.approx(-0.3, rel=2**-9)

    def test_outliers_are_clipped_where_16_bits_are_too_few(self) -> None:
        values = np.array([0.001, 0.002, 0.003, 900.0], np.float32)
        quantiser = Quantiser.of_step(values, 0.001, self.BOUNDS)
        stored = values_of_codes(quantiser, quantiser.quantise(values))
        assert quantiser.bits == 16
        np.testing.assert_allclose(stored[:3], values[:3], atol=1e-5)
        assert 30 < stored[3] < 66

    def test_steps_are_longer_where_the_bounds_leave_too_few(self) -> None:
        """Of 491 multiples within the bounds 8 bits reach over 256, 12.5 in all."""
        values = np.array([-5.84, 0.0, 3.3, 3.4, 7.2], np.float32)
        quantiser = Quantiser.of_step(values, 0.0488, (-12.0, 12.0))
        assert quantiser.step == 24 / 256
        stored = values_of_codes(quantiser, quantiser.quantise(values))
        np.testing.assert_allclose(stored, values, atol=quantiser.step / 2)

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
    QUANTISERS = (Quantiser(16, -33, 0.1), Quantiser(9, 2, 1 / 3), Quantiser(1, 5, 1.0))

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
        found = values_of(codes, [Quantiser(16, -100, 0.2)], opacity)
        assert found.tolist() == [-12, 0, 12]
