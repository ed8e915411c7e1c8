"""Bits and quality that statistics of frames let expect."""

from __future__ import annotations

from typing import Any

import pytest

from gsvrcodec.encoder.analysis import FrameStats
from gsvrcodec.encoder.film_target import FilmSize
from gsvrcodec.encoder.rate import (
    bit_weights,
    bpp_at,
    crf_of,
    lasting,
    qscale_of,
    visited_frames,
)
from gsvrcodec.encoder.settings import EncodeSettings
from gsvrcodec.encoder.tuned import ANALYSIS, CRF, RATE
from gsvrcodec.fit.target import bit_worth
from gsvrcodec.fit.tuned import EFFORT, RATE_CONTROL
from tests.encoder.chains import chains_of, of_film, of_rate

STATS = [FrameStats(0.1, False, 5.0, 300.0)] * 60
SIZE = (320, 180)


class TestLasting:
    """Two GOPs of four and six frames are predicted from one of four, one from the other."""

    CHAIN = chains_of([4, 4, 6])[0]

    @pytest.mark.parametrize(
        ("first", "second", "frames"),
        [(0.0, 0.0, 14), (1.0, 0.0, 4), (0.0, 1.0, 8), (0.25, 0.25, 11.5), (0.25, 0.5, 7)],
    )
    def test_until_the_picture_changes(self, first: float, second: float, frames: float) -> None:
        changed = [0.0] * 4 + [first] * 4 + [second] * 6
        stats = [FrameStats(0.0, False, changed=(share,) * 5) for share in changed]
        assert lasting(self.CHAIN, stats, 36.0) == pytest.approx(frames / 4)

    def test_a_gop_that_none_is_predicted_from(self) -> None:
        assert lasting(chains_of([9])[0], STATS, 36.0) == 1


class TestBitWeights:
    def test_they_follow_what_changes(self) -> None:
        stats = [FrameStats(0.0, False, changed=(0.25 * (n // 4),) * 5) for n in range(12)]
        (chain,) = chains_of([4, 4, 4])
        key, second, third = bit_weights(chain, stats, 36.0)
        still = [FrameStats(0.0, False, changed=(0.0,) * 5)] * 12
        idle = bit_weights(chain, still, 36.0)[2]
        assert 0 < idle < second < third < key == 1
        assert third - second == pytest.approx(second - idle)

    def test_more_changes_at_a_higher_quality(self) -> None:
        assert ANALYSIS.qualities[:2] == (28, 32)
        stats = [FrameStats(0.0, False, changed=(0.1, 0.3, 0.5, 0.7, 0.9))] * 8
        (chain,) = chains_of([4, 4])
        weights = [bit_weights(chain, stats, psnr)[1] for psnr in (20, 28, 30, 32, 44, 60)]
        low, first, between, second, high, highest = weights
        assert low == first < second < high == highest
        assert between == pytest.approx((first + second) / 2)

    def test_they_follow_the_complexity(self) -> None:
        (chain,) = chains_of([4, 4])
        easy, hard = (
            bit_weights(chain, [*STATS[:4], *[FrameStats(0.1, False, change, 300.0)] * 4], 36.0)[1]
            for change in (5.0, 80.0)
        )
        assert 0.5 < easy < 1
        assert hard > 1.2 * easy


def test_a_high_quality_takes_more_visits() -> None:
    usual = EncodeSettings(params=9).frame_visits
    assert usual == EFFORT.frame_visits["medium"]
    assert EncodeSettings(crf=CRF.at + 5).frame_visits == usual
    finer = EncodeSettings(crf=CRF.at - CRF.octave).frame_visits
    assert finer == pytest.approx(2 * usual)
    assert EncodeSettings(preset="fastest").frame_visits < usual


class TestExpected:
    def expected(self, **settings: Any) -> tuple[float, float]:
        target = of_film(EncodeSettings(**of_rate(STATS, **settings)))
        return target.bpp(STATS, SIZE, 3.0), target.psnr(STATS, SIZE, 3.0)

    @pytest.mark.parametrize(
        "settings",
        [{"bpp": 0.1}, {"bitrate": 115_200}, {"target_size": 43_200}],
        ids=str,
    )
    def test_a_size_is_met_by_a_quality(self, settings: dict[str, Any]) -> None:
        target = EncodeSettings(**settings).target
        assert isinstance(target, FilmSize)
        guess = target.guess(STATS, SIZE, 3.0)
        assert RATE.taken * guess.bpp(STATS, SIZE, 3.0) == pytest.approx(0.1)

    @pytest.mark.parametrize(("bpp", "crf"), [(1e-5, CRF.highest), (1e3, 0.0)])
    def test_a_guess_is_on_the_scale(self, bpp: float, crf: float) -> None:
        assert FilmSize("bpp", bpp).guess(STATS, SIZE, 3.0).crf == crf
        assert FilmSize("target_size", -9).guess(STATS, SIZE, 3.0).crf == CRF.highest

    def test_by_quality(self) -> None:
        bpp, psnr = self.expected(target_psnr=35.0)
        assert psnr == 35
        assert self.expected(bpp=bpp) == pytest.approx((bpp, psnr))

    def test_by_slope(self) -> None:
        bpp, psnr = self.expected(crf=28)
        assert self.expected(bpp=bpp) == pytest.approx((bpp, psnr))
        assert self.expected(crf=34)[0] < 0.7 * bpp

    def test_nothing_tells_the_size(self) -> None:
        for settings in ({"gaussians": 9}, {"profile": "paper"}, {"profile": "paper", "params": 9}):
            assert self.expected(**settings) == (float("inf"), RATE.usual_psnr)


class TestSlope:
    def test_the_scale_of_constant_quality(self) -> None:
        assert qscale_of(CRF.at) == CRF.qscale
        assert qscale_of(CRF.at + CRF.octave) == pytest.approx(2 * CRF.qscale)
        assert qscale_of(0) >= RATE_CONTROL.finest
        assert qscale_of(51) <= RATE_CONTROL.coarsest
        assert [crf_of(qscale_of(crf)) for crf in (12, 26, 44)] == pytest.approx([12, 26, 44])
        assert (crf_of(1e-9), crf_of(1e9)) == (0, CRF.highest)

    @pytest.mark.parametrize("qscale", [0.5, 2.0])
    def test_a_bit_more_saves_what_it_is_worth(self, qscale: float) -> None:
        bpp = bpp_at(STATS, qscale)
        errors = []
        for bits in (0.999 * bpp, 1.001 * bpp):
            psnr = of_film(EncodeSettings(**of_rate(STATS, bpp=bits))).psnr(STATS, SIZE, 3.0)
            errors.append(255.0**2 / 10 ** (psnr / 10))
        slope = (errors[0] - errors[1]) / (0.002 * bpp)
        assert slope == pytest.approx(bit_worth(qscale), rel=1e-3)

    def test_more_bits_for_what_is_complex(self) -> None:
        wild = [FrameStats(0.1, False, 50.0, 300.0)] * 60
        assert bpp_at(wild, 1.0) > 1.3 * bpp_at(STATS, 1.0)


def test_a_short_gop_takes_as_many_steps_as_a_longer_one() -> None:
    assert visited_frames(2) == visited_frames(EFFORT.least_frames) == EFFORT.least_frames
    assert visited_frames(1) == EFFORT.still_frames < EFFORT.least_frames
    assert visited_frames(100) == 100
