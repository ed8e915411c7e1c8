"""Rate curves: BD-rate against published code and against sums that can be done by hand."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from gsvrcodec.report.curve import RateCurve


def curve(rates: Sequence[float], qualities: Sequence[float]) -> RateCurve:
    return RateCurve(zip(qualities, rates, strict=True))


class TestBdRate:
    def test_published_code(self) -> None:
        # bjontegaard 1.3.0, bd_rate(..., method="pchip").
        anchor = curve([1000, 2000, 4000, 8000], [32, 35, 38, 40.5])
        test = curve([900, 1700, 3300, 7000], [32.3, 35.1, 37.9, 40.2])
        found = test.bd_rate(anchor)
        assert found is not None
        assert found.percent == pytest.approx(-15.013530140112163, abs=1e-9)
        assert (found.low, found.high) == (32.3, 40.2)

    def test_uneven_points_of_different_number(self) -> None:
        anchor = curve([1, 2.5, 4, 9, 20], [30, 33.5, 34.1, 38, 39])
        found = curve([1.1, 1.9, 6.0], [31.2, 32, 37]).bd_rate(anchor)
        assert found is not None
        assert found.percent == pytest.approx(8.457003782450379, abs=1e-9)
        assert (found.low, found.high) == (31.2, 37)

    def test_constant_factor(self) -> None:
        anchor = curve([1, 2, 4, 9], [30, 33, 35, 38])
        half = curve([4.5, 0.5, 2, 1], [38, 30, 35, 33])
        there, back = half.bd_rate(anchor), anchor.bd_rate(half)
        assert there is not None
        assert back is not None
        assert there.percent == pytest.approx(-50)
        assert back.percent == pytest.approx(100)

    @pytest.mark.parametrize("qualities", [[38.5, 40], [20, 30], [38]])
    def test_no_overlap(self, qualities: list[float]) -> None:
        anchor = curve([1, 2, 4], [30, 33, 38])
        assert curve([1, 2][: len(qualities)], qualities).bd_rate(anchor) is None


class TestRate:
    def test_points_are_met(self) -> None:
        found = curve([4, 1, 2], [35, 30, 33])
        assert [found.rate(q) for q in (30, 33, 35)] == pytest.approx([1, 2, 4])

    def test_two_points_are_joined_in_the_logarithm(self) -> None:
        assert curve([1, 4], [30, 32]).rate(31) == pytest.approx(2)

    def test_nothing_is_said_outside(self) -> None:
        assert curve([1, 4], [30, 32]).rate(32.01) is None
        assert curve([1, 4], [30, 32]).rate(29.99) is None
        assert curve([3], [30]).rate(30) == pytest.approx(3)

    def test_no_overshoot(self) -> None:
        steep = curve([1, 1.01, 8, 8.01], [30, 33, 33.5, 38])
        rates = [steep.rate(30 + n / 100) or 0 for n in range(801)]
        assert rates == sorted(rates)

    def test_cheapest_of_equal_quality(self) -> None:
        assert curve([5, 3, 9], [30, 30, 32]).rate(30) == pytest.approx(3)

    def test_quality_at_a_rate_is_the_inverse(self) -> None:
        found = curve([4, 1, 2, 9], [35, 30, 33, 36.5])
        for quality in (30.0, 31.7, 33.0, 34.9, 36.4):
            rate = found.rate(quality)
            assert rate is not None
            assert found.quality_at(rate) == pytest.approx(quality)

    def test_no_quality_outside(self) -> None:
        found = curve([1, 4], [30, 32])
        assert (found.quality_at(0.99), found.quality_at(4.01)) == (None, None)

    def test_no_point_fails(self) -> None:
        with pytest.raises(ValueError, match="needs a point"):
            RateCurve([])
