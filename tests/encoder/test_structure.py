"""Key GOPs or chains, and how long they are."""

from __future__ import annotations

from typing import Any

import pytest

from gsvrcodec.encoder.analysis import FrameStats
from gsvrcodec.encoder.film import ChainLimits, GopLimits, divided, limits
from gsvrcodec.encoder.film_target import ConstantQuality
from gsvrcodec.encoder.settings import EncodeSettings
from gsvrcodec.encoder.tuned import ANALYSIS, CHAIN
from gsvrcodec.fit.tuned import PREDICTION
from tests.encoder.chains import of_film, of_rate

STATS = [FrameStats(0.1, False, 5.0, 300.0)] * 60
SIZE = (320, 180)


def found(**settings: Any) -> tuple[GopLimits, ChainLimits | None]:
    chosen = EncodeSettings(**of_rate(STATS, **settings))
    bpp = of_film(chosen).bpp(STATS, SIZE, 3.0)
    return limits(bpp, len(STATS), chosen.structure, seconds=3.0)


@pytest.mark.parametrize(
    ("settings", "frames"),
    [
        ({}, 24),
        ({"bpp": 0.2}, 24),
        ({"bpp": 0.03}, 64),
        ({"bpp": 0.001}, 127),
        ({"target_psnr": 45.0}, 24),
        ({"gop_min": 40}, 40),
        ({"gop_max": 7, "gop_min": 1, "bpp": 0.01}, 7),
    ],
)
def test_longest_gop_of_a_chain(settings: dict[str, Any], frames: int) -> None:
    chained = found(**settings)[1]
    assert chained is not None
    assert chained.gops.longest == frames
    assert chained.gops.shortest == settings.get("gop_min", 6)


@pytest.mark.parametrize("keyint", [0, 4.0])
@pytest.mark.parametrize(
    ("settings", "frames"),
    [
        ({"gaussians": 9}, 32),
        ({"gop_min": 40, "bpp": 0.2}, 40),
        ({"gop_max": 7, "gop_min": 1, "bpp": 0.01}, 7),
        ({"bpp": 0.2}, 32),
        ({"bpp": 0.05}, 64),
        ({"bpp": 0.001}, 128),
        ({"profile": "paper"}, 32),
    ],
)
def test_longest_key_gop(settings: dict[str, Any], keyint: float, frames: int) -> None:
    alone, chained = found(keyint=keyint, **settings)
    assert alone.longest == frames
    assert (chained is None) == (keyint == 0 or settings.get("profile") == "paper")


def test_the_lower_the_rate_the_more_motion_a_gop_follows() -> None:
    def threshold(**settings: Any) -> float:
        alone, chained = found(**settings)
        assert alone.motion == ANALYSIS.threshold
        assert chained is not None
        return chained.gops.motion

    assert threshold(bpp=0.06) == CHAIN.threshold
    assert threshold(bpp=0.001) == threshold(bpp=0.001, gop_max=9) == 2 * CHAIN.threshold
    assert threshold(bpp=1.0) == CHAIN.shorter * CHAIN.threshold
    assert threshold(crf=20) < threshold(crf=26) < threshold(crf=36)


def test_low_quality_has_longer_key_gops() -> None:
    low, high = (found(target_psnr=psnr, keyint=0)[0].longest for psnr in (28.0, 40.0))
    assert low > 2 * high


@pytest.mark.parametrize(
    ("settings", "frames"),
    [
        ({}, 96),
        ({"keyint": 0.5}, 12),
        ({"keyint": 0.01}, 1),
        ({"keyint": 0}, None),
        ({"profile": "paper"}, None),
    ],
)
def test_longest_chain(settings: dict[str, Any], frames: int | None) -> None:
    chained = limits(0.1, 240, EncodeSettings(**settings).structure, seconds=10.0)[1]
    assert (chained and chained.longest) == frames


class TestStructure:
    """A chain where much stays as it is or motion is fast, else key GOPs."""

    def lengths(
        self, motion: float, changed: float, fast: float = 0.0, **settings: Any
    ) -> list[list[int]]:
        frame = FrameStats(motion, False, 5.0, 300.0, (changed,) * 5, fast)
        chosen = EncodeSettings(**of_rate([frame], **settings))
        chains = divided([frame] * 96, SIZE, chosen.structure, of_film(chosen), seconds=4.0)
        return [[len(gop) for gop in chain] for chain in chains]

    def test_what_stays_is_not_paid_for_again(self) -> None:
        (chain,) = self.lengths(0.2, 0.1, bpp=0.1)
        assert len(chain) == 6

    def test_slow_motion_all_over_has_long_key_gops(self) -> None:
        assert self.lengths(0.2, 1.0, bpp=0.1) == [[24]] * 4

    def test_fast_motion_has_short_gops(self) -> None:
        (chain,) = self.lengths(2.0, 1.0, target_psnr=36.0)
        assert max(chain) < 10

    @pytest.mark.parametrize("settings", [{"crf": 26}, {"crf": 26, "gop": 8}])
    def test_none_is_predicted_where_too_little_lasts(self, settings: dict[str, Any]) -> None:
        """Those of a size stay together, for they make up for each other."""
        lasting, changing = (1 - PREDICTION.kept + more for more in (-0.01, 0.01))
        (chain,) = self.lengths(2.0, lasting, fast=1.0, **settings)
        apart = self.lengths(2.0, changing, fast=1.0, **settings)
        assert [[length] for length in chain] == apart
        assert max(chain) < 10
        structure = EncodeSettings(bpp=0.1).structure
        assert not structure.parted
        frame = FrameStats(2.0, False, 5.0, 300.0, (changing,) * 5, 1.0)
        guess = ConstantQuality(26)
        assert len(divided([frame] * 96, SIZE, structure, guess, seconds=4.0)) == 1

    def test_what_rests_after_a_change_lasts(self) -> None:
        """As a page does that is scrolled now and then: most is new, but since the GOP before."""
        moves = FrameStats(9.0, False, 500.0, 900.0, (0.8,) * 5, 12.0)
        rests = FrameStats(0.0, False, 0.1, 900.0, (0.8,) * 5, 0.01)
        structure, frames = EncodeSettings(gop=8).structure, [rests] * 24
        frames[8:10] = [moves] * 2
        chains = divided(frames, SIZE, structure, ConstantQuality(26), seconds=1.0)
        assert [len(chain) for chain in chains] == [1, 2]

    def test_so_has_what_is_fast_before_a_still_picture(self) -> None:
        assert self.lengths(0.2, 0.3, bpp=0.05) == [[32]] * 3
        (chain,) = self.lengths(0.2, 0.3, fast=5.0, bpp=0.05)
        assert len(chain) > 6

    def test_one_gop_for_all_frames(self) -> None:
        assert self.lengths(0.0, 0.1, bpp=0.001) == [[96]]

    def test_a_fixed_length_is_predicted_whatever_it_costs(self) -> None:
        assert self.lengths(0.2, 0.3, bpp=0.05, gop=32) == [[32, 32, 32]]

    def test_without_prediction(self) -> None:
        for changed in (0.1, 1.0):
            assert {len(chain) for chain in self.lengths(2.0, changed, keyint=0)} == {1}
