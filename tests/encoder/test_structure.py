"""Key GOPs or chains, and how long they are."""

from __future__ import annotations

from typing import Any

import pytest

from gsvrcodec.encoder.analysis import FrameStats
from gsvrcodec.encoder.film import divided, limits
from gsvrcodec.encoder.film_target import ConstantQuality
from gsvrcodec.encoder.gop_lengths import GopLimits
from gsvrcodec.encoder.settings import EncodeSettings
from gsvrcodec.encoder.tuned import GOP_LENGTH, PATHS
from gsvrcodec.fit.tuned import PREDICTION
from tests.encoder.chains import of_film, of_rate

STATS = [FrameStats(0.1, False, 5.0, 300.0)] * 60
SIZE = (320, 180)


def found(**settings: Any) -> tuple[GopLimits, int | None]:
    chosen = EncodeSettings(**of_rate(STATS, **settings))
    bpp = of_film(chosen).bpp(STATS, SIZE, 3.0)
    return limits(bpp, len(STATS), chosen.structure, seconds=3.0)


@pytest.mark.parametrize("keyint", [0, 4.0])
@pytest.mark.parametrize(
    ("settings", "frames"),
    [
        ({"gaussians": 9}, 32),
        ({"gop_min": 40, "bpp": 0.2}, 40),
        ({"gop_max": 7, "gop_min": 1, "bpp": 0.01}, 7),
        ({"bpp": 0.2}, 32),
        ({"bpp": 0.02}, 50),
        ({"target_psnr": 45.0}, 32),
        ({"bpp": 0.001}, 128),
        ({"profile": "paper"}, 32),
    ],
)
def test_longest_gop(settings: dict[str, Any], keyint: float, frames: int) -> None:
    bounds, chained = found(keyint=keyint, **settings)
    assert bounds.longest == frames
    assert bounds.shortest == settings.get("gop_min", 4)
    # GOPs of given numbers end by motion: short ones would have few Gaussians.
    assert (bounds.price is None) == bool({"gaussians", "profile"} & {*settings})
    assert (chained is None) == (keyint == 0 or settings.get("profile") == "paper")


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
    assert chained == frames


class TestStructure:
    """A chain where much stays as it is or motion is fast, else key GOPs."""

    def lengths(
        self, motion: float, changed: float, fast: float = 0.0, **settings: Any
    ) -> list[list[int]]:
        left = tuple(2 * motion * length for length in PATHS.lengths)
        frame = FrameStats(motion, False, 5.0, 300.0, (changed,) * 5, fast, left)
        chosen = EncodeSettings(**of_rate([frame], **settings))
        chains = divided([frame] * 96, SIZE, chosen.structure, of_film(chosen), seconds=4.0)
        return [[len(gop) for gop in chain] for chain in chains]

    def test_what_stays_is_not_paid_for_again(self) -> None:
        (chain,) = self.lengths(2.0, 0.1, fast=1.0, bpp=0.1)
        assert len(chain) > 6

    def test_slow_motion_all_over_has_long_key_gops(self) -> None:
        assert self.lengths(0.2, 1.0, fast=1.0, bpp=0.1) == [[32]] * 3

    def test_fast_motion_has_short_gops(self) -> None:
        chains = self.lengths(20.0, 1.0, fast=1.0, target_psnr=40.0, preset="fastest")
        assert max(frames for chain in chains for frames in chain) < 10

    def test_it_has_as_short_ones_at_low_rates(self) -> None:
        chains = self.lengths(200.0, 1.0, fast=1.0, crf=40, preset="fastest")
        assert {frames for chain in chains for frames in chain} == {4}

    def test_the_more_effort_the_longer_gops(self) -> None:
        """Gaussians have more time to follow motion."""
        quick, slow = (
            self.lengths(10.0, 1.0, fast=1.0, crf=26, preset=preset)
            for preset in ("fastest", "slow")
        )
        assert len(slow) < len(quick)

    def test_the_fewer_bits_the_longer_gops(self) -> None:
        def mean(**settings: Any) -> float:
            chains = self.lengths(10.0, 1.0, fast=1.0, **settings)
            return 96 / sum(map(len, chains))

        for rates in ({"crf": (20, 26, 32)}, {"bpp": (0.3, 0.1, 0.03)}, {"target_psnr": (42, 36)}):
            (name, values), *_ = rates.items()
            means = [mean(**{name: value}) for value in values]
            assert means == sorted(means)
            assert means[-1] > 1.3 * means[0]

    def test_a_gop_takes_less_of_more_pixels(self) -> None:
        left = tuple(9.0 * length for length in PATHS.lengths)
        frames = [FrameStats(2.0, False, 5.0, 300.0, fast=1.0, left=left)] * 96
        structure, target = EncodeSettings().structure, ConstantQuality(26)
        small, large = (
            sum(map(len, divided(frames, size, structure, target, seconds=4.0)))
            for size in ((640, 360), (3840, 2160))
        )
        assert small < large

    def test_published_gops_end_by_motion(self) -> None:
        chains = self.lengths(2.0, 1.0, profile="paper")
        assert {len(gop) for chain in chains for gop in [chain]} == {1}
        assert max(map(max, chains)) <= GOP_LENGTH.motion / 2

    @pytest.mark.parametrize("settings", [{"crf": 26}, {"crf": 26, "gop": 8}])
    def test_none_is_predicted_where_too_little_lasts(self, settings: dict[str, Any]) -> None:
        """Those of a size stay together, for they make up for each other."""
        lasting, changing = (1 - PREDICTION.kept + more for more in (-0.01, 0.01))
        (chain,) = self.lengths(9.0, lasting, fast=1.0, **settings)
        apart = self.lengths(9.0, changing, fast=1.0, **settings)
        assert {len(gops) for gops in apart} == {1}
        # A GOP that begins with less takes less, and so there are more of them.
        assert len(chain) >= len(apart)
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

    def test_one_gop_for_all_frames(self) -> None:
        assert self.lengths(0.0, 0.1, bpp=0.001) == self.lengths(0.0, 0.0, bpp=0.001) == [[96]]

    def test_a_fixed_length_is_predicted_whatever_it_costs(self) -> None:
        assert self.lengths(0.2, 0.3, bpp=0.05, gop=32) == [[32, 32, 32]]

    def test_without_prediction(self) -> None:
        for changed in (0.1, 1.0):
            assert {len(chain) for chain in self.lengths(2.0, changed, keyint=0)} == {1}
