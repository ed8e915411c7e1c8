"""Budgets: what is asked for is never passed, and shared fairly."""

from __future__ import annotations

from collections.abc import Iterable
from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gsvrcodec.encoder.film import Chain
from gsvrcodec.encoder.plan import (
    allocate,
    grid_parameters,
    most_gaussians,
    triplane_grid,
)
from gsvrcodec.encoder.settings import EncodeSettings
from gsvrcodec.errors import UsageError
from gsvrcodec.fit.recipe import Deform, Profile
from gsvrcodec.model.attributes import gaussian_parameters
from tests.encoder.chains import chains_of

LENGTHS = st.lists(st.lists(st.integers(1, 60), min_size=1, max_size=5), min_size=1, max_size=6)
SIZES = st.tuples(st.integers(1, 4000), st.integers(1, 4000))


def key_gops(lengths: Iterable[Iterable[int]]) -> list[Chain]:
    """Return as many GOPs of these lengths, none of them predicted."""
    return chains_of(*([length] for own in lengths for length in own))


def stored(
    chains: list[Chain], gaussians: list[int], size: tuple[int, int], settings: EncodeSettings
) -> int:
    """Return how many numbers a file of key GOPs holds."""
    blending = settings.blending
    return gaussian_parameters(blending) * sum(gaussians) + sum(
        grid_parameters(triplane_grid(size, len(gop), settings), blending)
        for chain in chains
        for gop in chain
    )


@given(
    lengths=LENGTHS,
    size=SIZES,
    params=st.integers(1, 10_000_000),
    deform=st.sampled_from(get_args(Deform)),
    profile=st.sampled_from(get_args(Profile)),
)
def test_params_are_an_upper_bound(
    lengths: list[list[int]],
    size: tuple[int, int],
    params: int,
    deform: Deform,
    profile: Profile,
) -> None:
    settings = EncodeSettings(params=params, deform=deform, profile=profile)
    chains = key_gops(lengths)
    if stored(chains, [1] * len(chains), size, settings) > params:
        with pytest.raises(UsageError, match="raise `params`"):
            allocate(chains, size, settings)
        return
    gaussians = allocate(chains, size, settings)
    assert len(gaussians) == len(chains)
    assert min(gaussians) >= 1
    assert stored(chains, gaussians, size, settings) <= params


@given(lengths=LENGTHS, size=SIZES, profile=st.sampled_from(get_args(Profile)))
def test_without_a_budget_every_size_is_possible(
    lengths: list[list[int]], size: tuple[int, int], profile: Profile
) -> None:
    chains = key_gops(lengths)
    gaussians = allocate(chains, size, EncodeSettings(profile=profile))
    assert len(gaussians) == len(chains)
    assert min(gaussians) >= 1
    assert max(gaussians) <= most_gaussians(size)


@given(lengths=LENGTHS, size=SIZES, count=st.integers(1, 10**6))
def test_gaussians_are_taken_as_they_are(
    lengths: list[list[int]], size: tuple[int, int], count: int
) -> None:
    found = allocate(chains_of(*lengths), size, EncodeSettings(gaussians=count))
    assert found == [count] * len(lengths)


def test_a_budget_is_used_up() -> None:
    settings = EncodeSettings(params=3_000_000)
    chains = chains_of(*[[24]] * 5, [12])
    used = stored(chains, allocate(chains, (1280, 640), settings), (1280, 640), settings)
    assert 0.99 * 3_000_000 < used <= 3_000_000


def test_every_frame_has_as_many_numbers() -> None:
    short, long = allocate(chains_of([16], [48]), (1280, 640), EncodeSettings(params=900_000))
    assert long == pytest.approx(3 * short, rel=0.1)


def test_grid_of_the_paper() -> None:
    assert triplane_grid((1280, 640), 24, EncodeSettings(profile="paper")) == (32, 16, 12)
    assert triplane_grid((1280, 640), 1, EncodeSettings(profile="paper")) == (32, 16, 1)
