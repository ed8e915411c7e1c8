"""Plans: what a file is to take is shared among its chains and their GOPs."""

from __future__ import annotations

from typing import Any

import pytest

from gsvrcodec.encoder.analysis import FrameStats
from gsvrcodec.encoder.plan import Budget, grid_parameters, most_gaussians, plan
from gsvrcodec.encoder.rate import qscale_of
from gsvrcodec.encoder.settings import EncodeSettings
from gsvrcodec.encoder.tuned import RATE
from tests.encoder.chains import chains_of, of_rate


class TestChains:
    """A chain shares its bytes: most for the key GOP, and the more the more moves."""

    SIZE = (640, 360)

    def plan(self, *lengths: list[int], changed: float = 0.5, **settings: Any) -> list[Budget]:
        frames = sum(map(sum, lengths))
        stats = [
            FrameStats(0.4, not number, 9.0, 300.0, (changed,) * 5) for number in range(frames)
        ]
        chosen = EncodeSettings(**of_rate(stats, **settings))
        return plan(chains_of(*lengths), stats, self.SIZE, chosen, seconds=frames / 24)

    def test_no_size_is_to_be_met(self) -> None:
        budgets = self.plan([16, 16], bpp=0.1)
        assert {(budget.bytes, budget.plate_bytes) for budget in budgets} == {(0, 0)}

    def test_where_little_changes_a_key_gop_has_more_gaussians(self) -> None:
        idle, wild = (self.plan([16] * 3, changed=changed, bpp=0.1) for changed in (0.0, 1.0))
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

    def test_all_gops_of_a_chain_have_as_many_gaussians(self) -> None:
        for settings in ({"bpp": 0.1}, {"params": 500_000}):
            budgets = self.plan([16, 16, 16], [16], **settings)
            assert len({budget.gaussians for budget in budgets[:3]}) == 1
            assert budgets[3].gaussians != budgets[0].gaussians

    def test_there_is_a_most(self) -> None:
        budgets = self.plan([16, 16], params=10**8)
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


def test_a_grid_has_a_share_of_the_numbers() -> None:
    stats = [FrameStats(0.4, False, 9.0, 300.0)] * 20
    numbers, grids = [], []
    for bpp in (0.01, 0.08, 0.2, 4.0):
        settings = EncodeSettings(**of_rate(stats, bpp=bpp))
        budget = plan([[range(20)]], stats, (640, 360), settings, seconds=1.0)[0]
        assert budget.grid is not None
        grids.append(budget.grid)
        numbers.append(grid_parameters(budget.grid, "mean") / (RATE.taken * budget.gaussians))
    assert grids[0] == (4, 4, 20)  # no fewer
    assert grids[-1] == (32, 18, 20)  # no more
    # 0.04 of 14 numbers of a Gaussian that is expected, but for cells that are whole
    assert numbers[1:3] == pytest.approx([0.56] * 2, rel=0.12)


class TestPlan:
    SIZE = (320, 180)

    def stats(self, *changes: float) -> list[FrameStats]:
        """Return 30 frames of each of these rates of change."""
        return [FrameStats(0.1, False, change, 300.0) for change in changes for _ in range(30)]

    def budgets(self, *changes: float, **settings: Any) -> list[Budget]:
        chains = chains_of(*[[30]] * len(changes))
        chosen = EncodeSettings(**settings)
        return plan(chains, self.stats(*changes), self.SIZE, chosen, seconds=2.0)

    def test_what_is_harder_gets_more(self) -> None:
        static, moving = self.budgets(1, 50, crf=26)
        assert 1.3 * static.gaussians < moving.gaussians

    def test_a_quality_is_the_same_for_all(self) -> None:
        static, moving = self.budgets(1, 30, crf=26)
        assert static.slope == moving.slope
        assert static.gaussians < moving.gaussians
        assert self.budgets(1, crf=24)[0].gaussians > static.gaussians

    def test_no_target(self) -> None:
        assert self.budgets(1, 30, gaussians=77) == [Budget(77)] * 2
