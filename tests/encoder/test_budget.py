"""Budgets: what is asked for is never passed, and shared fairly."""

from __future__ import annotations

import itertools
from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gsvrcodec.encoder.budget import (
    allocate,
    grid_parameters,
    most_gaussians,
    triplane_grid,
)
from gsvrcodec.encoder.settings import EncodeSettings
from gsvrcodec.errors import UsageError
from gsvrcodec.fit.options import Deform, Profile
from gsvrcodec.model.gop import GAUSSIAN_PARAMETERS

LENGTHS = st.lists(st.integers(1, 60), min_size=1, max_size=12)
SIZES = st.tuples(st.integers(1, 4000), st.integers(1, 4000))


def ranges(lengths: list[int]) -> list[range]:
    """Return GOPs of these lengths."""
    stops = list(itertools.accumulate(lengths))
    return [range(stop - length, stop) for stop, length in zip(stops, lengths, strict=True)]


def stored(
    gops: list[range], gaussians: list[int], size: tuple[int, int], settings: EncodeSettings
) -> int:
    """Return how many numbers a file holds."""
    grids = [grid_parameters(triplane_grid(size, len(gop), settings)) for gop in gops]
    return GAUSSIAN_PARAMETERS * sum(gaussians) + sum(grids)


@given(
    lengths=LENGTHS,
    size=SIZES,
    params=st.integers(1, 10_000_000),
    deform=st.sampled_from(get_args(Deform)),
    profile=st.sampled_from(get_args(Profile)),
)
def test_params_are_an_upper_bound(
    lengths: list[int], size: tuple[int, int], params: int, deform: Deform, profile: Profile
) -> None:
    settings = EncodeSettings(params=params, deform=deform, profile=profile)
    gops = ranges(lengths)
    if stored(gops, [1] * len(gops), size, settings) > params:
        with pytest.raises(UsageError, match="raise `params`"):
            allocate(gops, size, settings)
        return
    gaussians = allocate(gops, size, settings)
    assert len(gaussians) == len(gops)
    assert min(gaussians) >= 1
    assert stored(gops, gaussians, size, settings) <= params


@given(lengths=LENGTHS, size=SIZES, profile=st.sampled_from(get_args(Profile)))
def test_without_a_budget_every_size_is_possible(
    lengths: list[int], size: tuple[int, int], profile: Profile
) -> None:
    gaussians = allocate(ranges(lengths), size, EncodeSettings(profile=profile))
    assert len(gaussians) == len(lengths)
    assert min(gaussians) >= 1
    assert max(gaussians) <= most_gaussians(size)


@given(lengths=LENGTHS, size=SIZES, count=st.integers(1, 10**6))
def test_gaussians_are_taken_as_they_are(
    lengths: list[int], size: tuple[int, int], count: int
) -> None:
    assert allocate(ranges(lengths), size, EncodeSettings(gaussians=count)) == [count] * len(
        lengths
    )


def test_a_budget_is_used_up() -> None:
    gops = ranges([24, 24, 24, 24, 24, 12])
    settings = EncodeSettings(params=3_000_000)
    used = stored(gops, allocate(gops, (1280, 640), settings), (1280, 640), settings)
    assert 0.99 * 3_000_000 < used <= 3_000_000


def test_grid_of_the_paper() -> None:
    assert triplane_grid((1280, 640), 24, EncodeSettings(profile="paper")) == (32, 16, 12)
    assert triplane_grid((1280, 640), 1, EncodeSettings(profile="paper")) == (32, 16, 1)


@pytest.mark.parametrize("profile", get_args(Profile))
def test_no_grid_for_a_polynomial(profile: Profile) -> None:
    settings = EncodeSettings(deform="polynomial", profile=profile)
    assert triplane_grid((1280, 640), 24, settings) == (0, 0, 0)
    assert grid_parameters((0, 0, 0)) == 0


def test_at_most_a_gaussian_for_two_pixels() -> None:
    assert most_gaussians((1280, 640)) == 409_600
    assert most_gaussians((1, 1)) == 1
