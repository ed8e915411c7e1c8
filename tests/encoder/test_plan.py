"""Budgets: what is asked for is never passed, and shared fairly."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any, ClassVar, get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gsvrcodec.encoder.analysis import FrameStats
from gsvrcodec.encoder.background import StillShot
from gsvrcodec.encoder.plan import (
    Budget,
    Plan,
    allocate,
    grid_parameters,
    longest_gop,
    plan,
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
        with pytest.raises(UsageError, match="raise --params"):
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
    assert max(gaussians) <= max(1, size[0] * size[1] // 2)


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


class TestBackgrounds:
    """What a background gets is taken from its GOPs, and from no other."""

    SIZE = (640, 360)
    GOPS = ranges([20] * 6)
    STEPS: ClassVar = [FrameStats(0.4, number == 100, 9.0, 300.0) for number in range(120)]
    SHOT = StillShot(1, range(1, 5), 0.9, b"")

    def plan(self, *stills: StillShot, **settings: Any) -> Plan:
        chosen = EncodeSettings(**settings)
        return plan(
            self.GOPS, self.STEPS, self.SIZE, chosen, seconds=5.0, overhead=900, stills=stills
        )

    def test_bytes(self) -> None:
        before, after = self.plan(bpp=0.1), self.plan(self.SHOT, bpp=0.1)
        ((shot, background),) = after.backgrounds
        assert shot is self.SHOT
        assert background.target_bytes is not None
        sizes = [[budget.target_bytes or 0 for budget in p.gops] for p in (before, after)]
        assert sizes[0][0] == sizes[1][0]
        assert sizes[0][5] == sizes[1][5]
        assert sum(sizes[0]) == sum(sizes[1]) + background.target_bytes
        assert background.target_bytes > max(sizes[1])
        assert background.gaussians > after.gops[1].gaussians
        assert [budget.gaussians for budget in after.gops[1:5]] < [
            budget.gaussians for budget in before.gops[1:5]
        ]

    def test_parameters(self) -> None:
        after = self.plan(self.SHOT, params=400_000)
        ((_, background),) = after.backgrounds
        grids = sum(
            grid_parameters(triplane_grid(self.SIZE, 20, EncodeSettings())) for _ in self.GOPS
        )
        own = sum(budget.gaussians for budget in after.gops)
        total = grids + GAUSSIAN_PARAMETERS * own + 8 * background.gaussians
        assert 0.99 * 400_000 < total < 1.001 * 400_000

    def test_a_quality(self) -> None:
        after = self.plan(self.SHOT, target_psnr=35)
        ((_, background),) = after.backgrounds
        assert 36 < (background.target_psnr or 0) < 40
        assert {budget.target_psnr for budget in after.gops} == {35}

    def test_more_gops_share_a_smaller_part(self) -> None:
        parts = []
        for gops in (range(1, 3), range(1, 5)):
            shot = replace(self.SHOT, gops=gops)
            ((_, background),) = self.plan(shot, bpp=0.1).backgrounds
            parts.append((background.target_bytes or 0) / len(gops))
        assert parts[1] < parts[0]

    def test_too_few_bytes_for_one(self) -> None:
        assert self.plan(self.SHOT, bpp=0.0055).backgrounds == []

    def test_in_front_of_a_background_the_grid_is_coarse(self) -> None:
        grids = [budget.grid for budget in self.plan(self.SHOT, bpp=0.4).gops]
        assert grids[1:5] == [(16, 9, 10)] * 4
        assert grids[0] == grids[5] == (32, 18, 20)


def test_a_dear_grid_is_coarse() -> None:
    steps = [FrameStats(0.4, False, 9.0, 300.0)] * 20
    grids = [
        plan([range(20)], steps, (640, 360), EncodeSettings(bpp=bpp), seconds=1.0, overhead=0)
        .gops[0]
        .grid
        for bpp in (0.02, 0.2)
    ]
    assert grids == [(16, 9, 20), (32, 18, 20)]


class TestPlan:
    SIZE = (320, 180)

    def steps(self, *changes: float) -> list[FrameStats]:
        """Return 30 frames of each of these rates of change."""
        return [FrameStats(0.1, False, change, 300.0) for change in changes for _ in range(30)]

    def budgets(self, *changes: float, **settings: Any) -> list[Budget]:
        gops = ranges([30] * len(changes))
        chosen = EncodeSettings(**settings)
        return plan(gops, self.steps(*changes), self.SIZE, chosen, seconds=2.0, overhead=1000).gops

    @pytest.mark.parametrize(
        ("settings", "total"),
        [
            ({"bpp": 0.2}, 0.2 * 320 * 180 * 90 / 8),
            ({"bitrate": 800_000}, 200_000),
            ({"target_size": 150_000}, 150_000),
        ],
    )
    def test_the_file_is_used_up(self, settings: dict[str, Any], total: float) -> None:
        sizes = [budget.target_bytes or 0 for budget in self.budgets(9, 2, 30, **settings)]
        assert total - 1000 - 3 <= sum(sizes) <= total - 1000

    def test_copied_streams_count_for_the_size_alone(self) -> None:
        gops, steps = ranges([30]), self.steps(9)
        for settings, less in (({"target_size": 90_000}, 20_000), ({"bpp": 0.2}, 0)):
            sizes = [
                plan(
                    gops,
                    steps,
                    self.SIZE,
                    EncodeSettings(**settings),
                    seconds=1.0,
                    overhead=1000,
                    streams=streams,
                )
                .gops[0]
                .target_bytes
                for streams in (0, 20_000)
            ]
            assert (sizes[0] or 0) - (sizes[1] or 0) == less

    def test_what_is_harder_gets_more(self) -> None:
        still, moving = self.budgets(1, 50, bpp=0.2)
        assert 1.3 * still.gaussians < moving.gaussians
        still, wild = self.budgets(1, 1e9, bpp=0.2)
        assert (wild.target_bytes or 0) < 20 * (still.target_bytes or 0)

    def test_a_quality_is_the_same_for_all(self) -> None:
        still, moving = self.budgets(1, 30, target_psnr=36.0)
        assert still.target_psnr == moving.target_psnr == 36.0
        assert still.gaussians < moving.gaussians
        assert self.budgets(1, target_psnr=38.0)[0].gaussians > still.gaussians

    def test_a_still_gop_of_few_gaussians_has_a_coarser_grid(self) -> None:
        few, many = (self.budgets(9, bpp=bpp)[0].grid for bpp in (0.02, 0.5))
        assert few == (8, 5, 15)
        assert many == triplane_grid(self.SIZE, 30, EncodeSettings()) == (16, 9, 30)

    def test_no_target(self) -> None:
        assert self.budgets(1, 30, gaussians=77) == [Budget(77)] * 2

    @pytest.mark.parametrize(
        ("settings", "message"),
        [
            ({"bpp": 1e-5}, "--bpp 1e-05 leaves 0 bytes for 1 GOPs"),
            ({"bitrate": 9000}, "--bitrate 9000 leaves 1250 bytes"),
            ({"target_size": 2000}, "--target-size 2000 leaves 1000 bytes"),
        ],
    )
    def test_too_little_fails(self, settings: dict[str, Any], message: str) -> None:
        with pytest.raises(UsageError, match=message):
            self.budgets(1, **settings)


@pytest.mark.parametrize(
    ("settings", "frames"),
    [
        ({}, 32),
        ({"gop_min": 40}, 40),
        ({"gop_max": 7, "gop_min": 1, "bpp": 0.01}, 7),
        ({"bpp": 0.2}, 32),
        ({"bpp": 0.05}, 64),
        ({"bpp": 0.001}, 128),
        ({"bitrate": 57600}, 64),
    ],
)
def test_longest_gop(settings: dict[str, Any], frames: int) -> None:
    steps = [FrameStats(0.1, False, 5.0, 300.0)] * 60
    chosen = EncodeSettings(**settings)
    assert longest_gop(steps, (320, 180), chosen, seconds=3.0) == frames


def test_low_quality_has_longer_gops() -> None:
    steps = [FrameStats(0.1, False, 5.0, 300.0)] * 60
    low, high = (
        longest_gop(steps, (320, 180), EncodeSettings(target_psnr=psnr), seconds=3.0)
        for psnr in (28.0, 40.0)
    )
    assert low > 2 * high
