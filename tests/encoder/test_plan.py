"""Plans: what a file is to take is shared among its chains and their GOPs."""

from __future__ import annotations

from typing import Any

import pytest

from gsvrcodec.encoder.analysis import FrameStats
from gsvrcodec.encoder.plan import Budget, grid_parameters, most_gaussians, plan
from gsvrcodec.encoder.rate import qscale_of
from gsvrcodec.encoder.settings import EncodeSettings
from gsvrcodec.errors import UsageError
from gsvrcodec.fit.target import Quality
from tests.encoder.chains import chains_of


class TestChains:
    """A chain shares its bytes: most for the key GOP, and the more the more moves."""

    SIZE = (640, 360)

    def plan(self, *lengths: list[int], changed: float = 0.5, **settings: Any) -> list[Budget]:
        frames = sum(map(sum, lengths))
        stats = [
            FrameStats(0.4, not number, 9.0, 300.0, (changed,) * 5) for number in range(frames)
        ]
        chosen = EncodeSettings(**settings)
        return plan(
            chains_of(*lengths), stats, self.SIZE, chosen, seconds=frames / 24, overhead=900
        )

    def test_bytes(self) -> None:
        budgets = self.plan([16, 16, 16], [16, 16], bpp=0.1)
        sizes = [budget.bytes for budget in budgets]
        total = 0.1 * 640 * 360 * 80 / 8 - 900
        assert total - 5 <= sum(sizes) <= total
        # Chains get bytes by their length, and their key GOPs more than the others.
        assert sum(sizes[:3]) == pytest.approx(1.5 * sum(sizes[3:]), rel=0.01)
        assert sizes[0] > 1.5 * sizes[1]
        assert abs(sizes[1] - sizes[2]) <= 1
        assert sizes[3] > 1.5 * sizes[4]

    def test_what_changes_gets_more(self) -> None:
        idle, wild = (self.plan([16] * 3, changed=changed, bpp=0.1) for changed in (0.0, 1.0))
        assert idle[1].bytes < 0.5 * wild[1].bytes
        # What is left where little changes is for the key GOP, and for its Gaussians.
        assert idle[0].bytes > 1.5 * wild[0].bytes
        assert idle[0].gaussians > 1.5 * wild[0].gaussians

    def test_wall_time_bounds_the_gaussians(self) -> None:
        def gaussians(**settings: Any) -> int:
            lengths = [8, 8, 8]
            chosen = {"bpp": 0.5, "changed": 1.0, "threads": 2, "device": "cpu", **settings}
            return self.plan(lengths, **chosen)[0].gaussians

        free, ample = gaussians(), gaussians(time_budget=100.0)
        assert ample == free
        short = gaussians(time_budget=0.2)
        assert short < free
        # Twice the time or twice the cores fit twice as many; a GPU has no such bound.
        assert gaussians(time_budget=0.4) == pytest.approx(2 * short, abs=2)
        assert gaussians(time_budget=0.2, threads=4) == pytest.approx(2 * short, abs=2)
        # Where little changes, most Gaussians are kept and take no time.
        assert gaussians(time_budget=0.2, changed=0.0) > 3 * short
        # The bytes stay as they are.
        assert self.plan([8, 8], bpp=0.5, time_budget=0.2)[0].bytes == (
            self.plan([8, 8], bpp=0.5)[0].bytes
        )

    def test_all_gops_of_a_chain_have_as_many_gaussians(self) -> None:
        for settings in ({"bpp": 0.1}, {"target_psnr": 33.0}, {"params": 500_000}):
            budgets = self.plan([16, 16, 16], [16], **settings)
            assert len({budget.gaussians for budget in budgets[:3]}) == 1
            assert budgets[3].gaussians != budgets[0].gaussians

    def test_there_is_a_most(self) -> None:
        budgets = self.plan([16, 16], bpp=20.0)
        assert {budget.gaussians for budget in budgets} == {most_gaussians(self.SIZE)}

    def test_a_slope_is_that_of_every_gop(self) -> None:
        budgets = self.plan([16, 16], [16], crf=26, changed=0.1)
        slopes = [budget.slope for budget in budgets]
        assert {slope and slope.qscale for slope in slopes} == {qscale_of(26)}
        assert slopes[0] is not None
        assert slopes[0].lasting > 1.3  # another GOP builds on it
        assert [slope and slope.lasting for slope in slopes[1:]] == [1.0, 1.0]
        assert self.plan([16], crf=20)[0].gaussians > 1.5 * self.plan([16], crf=26)[0].gaussians

    def test_predicted_gops_have_a_coarse_grid(self) -> None:
        grids = [budget.grid for budget in self.plan([20, 20], bpp=0.4)]
        assert grids == [(32, 18, 20), (16, 9, 20)]

    def test_too_little_for_the_gops_of_a_chain_fails(self) -> None:
        with pytest.raises(UsageError, match=r"for 5 GOPs of at least \d+;"):
            self.plan([16] * 5, target_size=5000)


def test_a_grid_has_a_share_of_the_numbers() -> None:
    stats = [FrameStats(0.4, False, 9.0, 300.0)] * 20
    numbers, grids = [], []
    for bpp in (0.01, 0.04, 0.1, 2.0):
        settings = EncodeSettings(bpp=bpp)
        budget = plan([[range(20)]], stats, (640, 360), settings, seconds=1.0)[0]
        assert budget.grid is not None
        grids.append(budget.grid)
        numbers.append(grid_parameters(budget.grid, "mean") / budget.gaussians)
    assert grids[0] == (4, 4, 20)  # no fewer
    assert grids[-1] == (32, 18, 20)  # no more
    # 0.04 of 14 numbers of a Gaussian, but for cells that are whole
    assert numbers[1:3] == pytest.approx([0.56] * 2, rel=0.12)


class TestPlan:
    SIZE = (320, 180)

    def stats(self, *changes: float) -> list[FrameStats]:
        """Return 30 frames of each of these rates of change."""
        return [FrameStats(0.1, False, change, 300.0) for change in changes for _ in range(30)]

    def budgets(self, *changes: float, **settings: Any) -> list[Budget]:
        chains = chains_of(*[[30]] * len(changes))
        chosen = EncodeSettings(**settings)
        return plan(chains, self.stats(*changes), self.SIZE, chosen, seconds=2.0, overhead=1000)

    @pytest.mark.parametrize(
        ("settings", "total"),
        [
            ({"bpp": 0.2}, 0.2 * 320 * 180 * 90 / 8),
            ({"bitrate": 800_000}, 200_000),
            ({"target_size": 150_000}, 150_000),
        ],
    )
    def test_the_file_is_used_up(self, settings: dict[str, Any], total: float) -> None:
        sizes = [budget.bytes for budget in self.budgets(9, 2, 30, **settings)]
        assert total - 1000 - 3 <= sum(sizes) <= total - 1000

    def test_copied_streams_count_for_the_size_alone(self) -> None:
        chains, stats = chains_of([30]), self.stats(9)
        for settings, less in (({"target_size": 90_000}, 20_000), ({"bpp": 0.2}, 0)):
            sizes = [
                plan(
                    chains,
                    stats,
                    self.SIZE,
                    EncodeSettings(**settings),
                    seconds=1.0,
                    overhead=1000,
                    streams=streams,
                )[0].bytes
                for streams in (0, 20_000)
            ]
            assert (sizes[0] or 0) - (sizes[1] or 0) == less

    def test_what_is_harder_gets_more(self) -> None:
        static, moving = self.budgets(1, 50, bpp=0.2)
        assert 1.3 * static.gaussians < moving.gaussians
        static, wild = self.budgets(1, 1e9, bpp=0.2)
        assert wild.bytes < 20 * static.bytes

    def test_a_quality_is_the_same_for_all(self) -> None:
        static, moving = self.budgets(1, 30, target_psnr=36.0)
        assert static.target == moving.target == Quality(36.0)
        assert static.gaussians < moving.gaussians
        assert self.budgets(1, target_psnr=38.0)[0].gaussians > static.gaussians

    def test_no_target(self) -> None:
        assert self.budgets(1, 30, gaussians=77) == [Budget(77)] * 2

    @pytest.mark.parametrize(
        ("settings", "message"),
        [
            ({"bpp": 1e-5}, "`bpp=1e-05` leaves 0 bytes for 1 GOP of"),
            ({"bitrate": 9000}, "`bitrate=9000` leaves 1250 bytes"),
            ({"target_size": 2000}, "`target_size=2000` leaves 1000 bytes"),
        ],
    )
    def test_too_little_fails(self, settings: dict[str, Any], message: str) -> None:
        with pytest.raises(UsageError, match=message):
            self.budgets(1, **settings)
