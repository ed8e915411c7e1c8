"""The search for the factor that meets a target."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gsvrcodec.fit.target import COARSEST, FINEST, Target, find_factor


@given(
    scale=st.floats(1e3, 1e6),
    slope=st.floats(0.2, 1.5),
    answer=st.floats(0.15, 10.0),
    first=st.floats(0.3, 4.0),
)
def test_a_size_is_met_from_below(scale: float, slope: float, answer: float, first: float) -> None:
    def size(factor: float) -> float:
        return scale * (math.pow(factor, -slope) + 0.1)

    wanted = Target.of_size(max(1, int(size(answer))))
    found = find_factor(size, wanted, first)
    assert size(found) <= wanted.value
    assert size(found) >= 0.98 * wanted.value - 2


@given(answer=st.floats(0.15, 10.0), first=st.floats(0.3, 4.0))
def test_a_quality_is_met(answer: float, first: float) -> None:
    def quality(factor: float) -> float:
        return 40 - 10 * math.log10(1 + factor**2)

    found = find_factor(quality, Target.of_psnr(quality(answer)), first)
    assert quality(found) == pytest.approx(quality(answer), abs=0.03)


def test_steps_in_the_size_do_no_harm() -> None:
    def size(factor: float) -> float:
        return 1000 * math.ceil(10 / factor)

    assert size(find_factor(size, Target.of_size(5500), 1.0)) == 5000


@pytest.mark.parametrize(("size", "end"), [(1e9, FINEST), (1.0, COARSEST)])
def test_out_of_reach(size: float, end: float) -> None:
    def measure(factor: float) -> float:
        return 1000 / factor

    assert find_factor(measure, Target.of_size(int(size)), 1.0) == pytest.approx(end)
