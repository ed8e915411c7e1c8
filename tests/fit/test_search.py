"""The search for the qscale that meets a target."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gsvrcodec.fit.search import Goal, find_qscale
from gsvrcodec.fit.tuned import RATE_CONTROL


@given(
    scale=st.floats(1e3, 1e6),
    slope=st.floats(0.2, 1.5),
    answer=st.floats(0.15, 10.0),
    first=st.floats(0.3, 4.0),
)
def test_a_size_is_met_from_below(scale: float, slope: float, answer: float, first: float) -> None:
    def size(qscale: float) -> float:
        return scale * (math.pow(qscale, -slope) + 0.1)

    wanted = Goal.of_size(max(1, int(size(answer))))
    found = find_qscale(size, wanted, first)
    assert size(found) <= wanted.value
    assert size(found) >= 0.98 * wanted.value - 2


@given(answer=st.floats(0.15, 10.0), first=st.floats(0.3, 4.0))
def test_a_quality_is_met(answer: float, first: float) -> None:
    def quality(qscale: float) -> float:
        return 40 - 10 * math.log10(1 + qscale**2)

    found = find_qscale(quality, Goal.of_psnr(quality(answer)), first)
    assert quality(found) == pytest.approx(quality(answer), abs=0.03)


def test_steps_in_the_size_do_no_harm() -> None:
    def size(qscale: float) -> float:
        return 1000 * math.ceil(10 / qscale)

    assert size(find_qscale(size, Goal.of_size(5500), 1.0)) == 5000


def test_a_jump_over_the_target_ends_the_search() -> None:
    """Sizes that leave the target out, as where a step is rounded to a power of two."""
    trials = []

    def size(qscale: float) -> float:
        trials.append(qscale)
        return (10_100 if qscale < 1.2 else 9_900) / math.pow(qscale, 0.2)

    target = round(10_000 * 1.2**-0.2)
    found = find_qscale(size, Goal.of_size(target), 1.0)
    assert found == pytest.approx(1.2, rel=0.01)
    assert size(found) < target
    assert len(trials) <= 9


@pytest.mark.parametrize(
    ("size", "end"), [(1e9, RATE_CONTROL.finest), (1.0, RATE_CONTROL.coarsest)]
)
def test_out_of_reach(size: float, end: float) -> None:
    def measure(qscale: float) -> float:
        return 1000 / qscale

    assert find_qscale(measure, Goal.of_size(int(size)), 1.0) == pytest.approx(end)
