"""Which Gaussians are worth their bits at a slope, and how many."""

from __future__ import annotations

import numpy as np
import pytest

from gsvrcodec.fit.target import Slope, bit_worth
from gsvrcodec.fit.tuned import SLOPE


class TestNumber:
    def test_one_more_would_save_its_bits(self) -> None:
        """At error = c * N^-fall, the saving of one more is fall * error * pixels / N."""
        slope, pixels, error = Slope(2.0, 10**9), 10**6, 40.0
        count = slope.gaussians(pixels, error, SLOPE.steps, 0.0)
        saving = SLOPE.fall * error * pixels / count
        assert saving == pytest.approx(SLOPE.gaussian_bits * bit_worth(2.0), rel=1e-3)

    def test_more_where_others_build_on_them(self) -> None:
        alone = Slope(2.0, 10**9).gaussians(10**6, 40.0, 500, 1.0)
        lasting = Slope(2.0, 10**9, lasting=3.0).gaussians(10**6, 40.0, 500, 1.0)
        assert lasting == pytest.approx(3 * alone, abs=2)

    def test_finer_steps_where_others_build_on_them(self) -> None:
        alone, lasting = Slope(2.0, 10), Slope(2.0, 10, lasting=3.0)
        assert alone.stored_qscale == alone.qscale == lasting.qscale == 2.0
        # At least as coarse as where each bit of the steps saves `lasting` times as much.
        assert 2.0 / 3**0.5 <= lasting.stored_qscale < 0.9 * 2.0

    def test_more_in_a_long_fit(self) -> None:
        short, long = (
            Slope(2.0, 10**9).gaussians(10**6, 40.0, steps, 1.0) for steps in (200, 6400)
        )
        assert long == pytest.approx(32**SLOPE.growth * short, abs=2)

    def test_fewer_where_they_move(self) -> None:
        still, half, all_of_them = (
            Slope(2.0, 10**9).gaussians(10**6, 40.0, 500, share) for share in (0.0, 0.5, 1.0)
        )
        assert still > half > all_of_them
        share = 1 + SLOPE.motion_bits / SLOPE.gaussian_bits
        assert still == pytest.approx(share * all_of_them, abs=2)

    @pytest.mark.parametrize("moving", [0.0, 0.1, 0.5, 1.0])
    def test_no_more_than_there_is_time_for(self, moving: float) -> None:
        slope = Slope(2.0, 10**9)
        free = slope.gaussians(10**6, 40.0, 500, moving)
        time = (1 - moving) * SLOPE.still_time + moving * SLOPE.moving_time
        for share in (1.1, 0.99 * SLOPE.scarce):
            fitted = free / share * time
            assert slope.gaussians(10**6, 40.0, 500, moving, fitted) == round(free / share)
        # Where bits pay for fewer than there is time for, they decide.
        assert slope.gaussians(10**6, 40.0, 500, moving, 1.1 * free * time) == free
        few = slope.gaussians(10**6, 1.0, 500, moving)
        assert slope.gaussians(10**6, 1.0, 500, moving, 90.0) == few

    def test_more_where_there_is_time_for_too_few(self) -> None:
        slope = Slope(2.0, 10**9)
        free = slope.gaussians(10**6, 40.0, 500, 1.0)
        enough = free / SLOPE.scarce * SLOPE.moving_time  # of time, for all that count
        for share in (4.0, 9.0):
            found = slope.gaussians(10**6, 40.0, 500, 1.0, enough / share)
            assert found == pytest.approx(free / SLOPE.scarce / share**0.5, rel=0.01)
        assert slope.gaussians(10**6, 40.0, 500, 1.0, 0.0) == 1

    def test_what_stands_still_takes_less_time(self) -> None:
        slope = Slope(2.0, 10**9)
        enough = 0.2 * slope.gaussians(10**6, 40.0, 500, 1.0) * SLOPE.moving_time
        still, moving = (slope.gaussians(10**6, 40.0, 500, share, enough) for share in (0, 1))
        assert still > 5 * moving

    def test_bounds(self) -> None:
        assert Slope(0.01, 500).gaussians(10**6, 40.0, 500, 1.0) == 500
        assert Slope(16.0, 500).gaussians(10, 0.0, 500, 1.0) == 1


STILL = np.zeros(5, np.bool_)


class TestWorthwhile:
    def test_by_the_error_without_them(self) -> None:
        least = SLOPE.gaussian_bits * bit_worth(0.5)
        losses = np.array([0.0, 0.9, 1.1, 4.0, 1e-9]) * least
        assert Slope(0.5, 9).worthwhile(losses, STILL).tolist() == [False, False, True, True, False]
        lasting = Slope(0.5, 9, lasting=1.2)
        assert lasting.worthwhile(losses, STILL).tolist() == [False, True, True, True, False]

    def test_what_moves_has_to_be_worth_its_motion_too(self) -> None:
        still, motion = SLOPE.gaussian_bits * bit_worth(0.5), SLOPE.motion_bits * bit_worth(0.5)
        losses = np.array([0.9, 1.1, 1.1]) * (still + motion)
        losses[2] -= motion
        chosen = Slope(0.5, 9).worthwhile(losses, np.array([True, True, False]))
        assert chosen.tolist() == [False, True, True]

    def test_the_best_one_stays(self) -> None:
        least = SLOPE.gaussian_bits * bit_worth(16.0)
        losses = np.array([0.0, 0.3, 0.1]) * least
        assert Slope(16.0, 9).worthwhile(losses, STILL[:3]).tolist() == [False, True, False]
        assert Slope(16.0, 9).worthwhile(np.zeros(3), STILL[:3]).sum() == 1
