"""Plans: what a file is to take is shared among its GOPs and backgrounds."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
import pytest

from gsvrcodec.encoder.analysis import FrameStats
from gsvrcodec.encoder.background import StaticRun
from gsvrcodec.encoder.budget import Budget, grid_parameters, triplane_grid
from gsvrcodec.encoder.plan import Plan, longest_gop, plan
from gsvrcodec.encoder.settings import EncodeSettings
from gsvrcodec.errors import UsageError
from gsvrcodec.model.gop import GAUSSIAN_PARAMETERS
from tests.encoder.test_budget import ranges


class TestBackgrounds:
    """What a background gets is taken from its GOPs, and from no other."""

    SIZE = (640, 360)
    GOPS = ranges([20] * 6)
    STATS: ClassVar = [FrameStats(0.4, number == 100, 9.0, 300.0) for number in range(120)]
    RUN = StaticRun(1, range(1, 5), 0.9, np.zeros((360, 640, 3), np.uint8))

    def plan(self, *runs: StaticRun, **settings: Any) -> Plan:
        chosen = EncodeSettings(**settings)
        return plan(self.GOPS, self.STATS, self.SIZE, chosen, seconds=5.0, overhead=900, runs=runs)

    def test_bytes(self) -> None:
        before, after = self.plan(bpp=0.1), self.plan(self.RUN, bpp=0.1)
        (planned,) = after.backgrounds
        background = planned.budget
        assert planned.run is self.RUN
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
        after = self.plan(self.RUN, params=400_000)
        (background,) = (planned.budget for planned in after.backgrounds)
        grids = sum(
            grid_parameters(triplane_grid(self.SIZE, 20, EncodeSettings())) for _ in self.GOPS
        )
        own = sum(budget.gaussians for budget in after.gops)
        total = grids + GAUSSIAN_PARAMETERS * own + 8 * background.gaussians
        assert 0.99 * 400_000 < total < 1.001 * 400_000

    def test_a_quality(self) -> None:
        after = self.plan(self.RUN, target_psnr=35)
        (background,) = (planned.budget for planned in after.backgrounds)
        assert 36 < (background.target_psnr or 0) < 40
        assert {budget.target_psnr for budget in after.gops} == {35}

    def test_more_gops_share_a_smaller_part(self) -> None:
        shares = []
        for gops in (range(1, 3), range(1, 5)):
            run = replace(self.RUN, gops=gops)
            (planned,) = self.plan(run, bpp=0.1).backgrounds
            shares.append((planned.budget.target_bytes or 0) / len(gops))
        assert shares[1] < shares[0]

    def test_too_few_bytes_for_one(self) -> None:
        assert self.plan(self.RUN, bpp=0.0055).backgrounds == []

    def test_in_front_of_a_background_the_grid_is_coarse(self) -> None:
        grids = [budget.grid for budget in self.plan(self.RUN, bpp=0.4).gops]
        assert grids[1:5] == [(16, 9, 10)] * 4
        assert grids[0] == grids[5] == (32, 18, 20)


def test_a_dear_grid_is_coarse() -> None:
    stats = [FrameStats(0.4, False, 9.0, 300.0)] * 20
    grids = [
        plan([range(20)], stats, (640, 360), EncodeSettings(bpp=bpp), seconds=1.0, overhead=0)
        .gops[0]
        .grid
        for bpp in (0.02, 0.2)
    ]
    assert grids == [(16, 9, 20), (32, 18, 20)]


class TestPlan:
    SIZE = (320, 180)

    def stats(self, *changes: float) -> list[FrameStats]:
        """Return 30 frames of each of these rates of change."""
        return [FrameStats(0.1, False, change, 300.0) for change in changes for _ in range(30)]

    def budgets(self, *changes: float, **settings: Any) -> list[Budget]:
        gops = ranges([30] * len(changes))
        chosen = EncodeSettings(**settings)
        return plan(gops, self.stats(*changes), self.SIZE, chosen, seconds=2.0, overhead=1000).gops

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
        gops, stats = ranges([30]), self.stats(9)
        for settings, less in (({"target_size": 90_000}, 20_000), ({"bpp": 0.2}, 0)):
            sizes = [
                plan(
                    gops,
                    stats,
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
        static, moving = self.budgets(1, 50, bpp=0.2)
        assert 1.3 * static.gaussians < moving.gaussians
        static, wild = self.budgets(1, 1e9, bpp=0.2)
        assert (wild.target_bytes or 0) < 20 * (static.target_bytes or 0)

    def test_a_quality_is_the_same_for_all(self) -> None:
        static, moving = self.budgets(1, 30, target_psnr=36.0)
        assert static.target_psnr == moving.target_psnr == 36.0
        assert static.gaussians < moving.gaussians
        assert self.budgets(1, target_psnr=38.0)[0].gaussians > static.gaussians

    def test_a_static_gop_of_few_gaussians_has_a_coarser_grid(self) -> None:
        few, many = (self.budgets(9, bpp=bpp)[0].grid for bpp in (0.02, 0.5))
        assert few == (8, 5, 15)
        assert many == triplane_grid(self.SIZE, 30, EncodeSettings()) == (16, 9, 30)

    def test_no_target(self) -> None:
        assert self.budgets(1, 30, gaussians=77) == [Budget(77)] * 2

    @pytest.mark.parametrize(
        ("settings", "message"),
        [
            ({"bpp": 1e-5}, "`bpp=1e-05` leaves 0 bytes for 1 GOPs"),
            ({"bitrate": 9000}, "`bitrate=9000` leaves 1250 bytes"),
            ({"target_size": 2000}, "`target_size=2000` leaves 1000 bytes"),
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
    stats = [FrameStats(0.1, False, 5.0, 300.0)] * 60
    chosen = EncodeSettings(**settings)
    assert longest_gop(stats, (320, 180), chosen, seconds=3.0) == frames


def test_low_quality_has_longer_gops() -> None:
    stats = [FrameStats(0.1, False, 5.0, 300.0)] * 60
    low, high = (
        longest_gop(stats, (320, 180), EncodeSettings(target_psnr=psnr), seconds=3.0)
        for psnr in (28.0, 40.0)
    )
    assert low > 2 * high
