"""First passes: what they tell of a size or a PSNR, and when another one follows."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gsvrcodec.bitstream.gop_payload import pack_gop
from gsvrcodec.encoder.first_pass import (
    PsnrGoal,
    Qualities,
    SizeGoal,
    Sizes,
    Taken,
    first_pass,
    plan_from_json,
    plan_to_json,
)
from gsvrcodec.encoder.plan import Budget
from gsvrcodec.encoder.rate import crf_of, qscale_of
from gsvrcodec.encoder.settings import EncodeSettings
from gsvrcodec.encoder.tuned import CRF, PSNR, SIZE
from gsvrcodec.fit.target import Quality, Slope
from gsvrcodec.fit.tuned import RATE_CONTROL
from tests.gops import BITS, make_chain, make_gop, make_payload
from tests.vectors.streams import a_plate

TAKEN = Taken(
    26.0, (60_000, 0, 0), (10_000, 20_000, 30_000), (36.0, 38.0, 37.5), (False, True, True)
)


def for_size(room: int, *, quick: bool = False) -> Sizes:
    return SizeGoal(room).plan(TAKEN, quick=quick)


def with_plate(plate: bytes) -> bytes:
    times = 40 * np.arange(3), np.full(3, 40)
    return pack_gop(make_gop(20), *times, 0, BITS, plate=plate)


class TestTaken:
    def test_plates_are_apart_and_count_once(self) -> None:
        one, other = a_plate(64, 48), a_plate(64, 48, 1)
        payloads = [with_plate(one), make_payload(), with_plate(one), with_plate(other)]
        bare = len(payloads[0]) - len(one)
        psnrs = [35.0, 36.0, 37.0, 38.0]
        taken = Taken.by(30.0, payloads, psnrs, share=True)
        assert taken.plates == (len(one), 0, 0, len(other))
        assert taken.others == (bare, len(payloads[1]), bare, bare)
        assert Taken.by(30.0, payloads, psnrs, share=False).plates == (
            len(one),
            0,
            len(one),
            len(other),
        )
        assert taken.predicted == (False,) * 4
        assert taken.mean_psnr([1, 1, 1, 5]) == 37.25
        assert Taken.by(30.0, make_chain((3, 2)), psnrs[:2], share=True).predicted == (False, True)

    def test_json(self) -> None:
        for found in (for_size(50_000), PsnrGoal(33.0, (3, 3, 3)).plan(TAKEN, quick=False)):
            assert plan_from_json(json.loads(json.dumps(plan_to_json(found)))) == found
        assert plan_from_json({"crf": 26.0}) is None

    @given(st.integers(10_000, 110_000) | st.integers(130_000, 1_000_000))
    def test_for_a_size(self, room: int) -> None:
        found = for_size(room)
        assert crf_of(RATE_CONTROL.finest) <= found.crf <= crf_of(RATE_CONTROL.coarsest)
        if room > 15_000:  # in reach
            assert room - 6 <= found.total <= room
        assert (found.crf < TAKEN.crf) == (room > TAKEN.total)
        # Those that take more still do, and none takes less than its head.
        assert found.plates[1:] == (0, 0)
        assert SIZE.head_bytes <= found.others[0] <= found.others[1] <= found.others[2]
        # All but plates loses the most.
        more = found.others[0] / TAKEN.others[0] > found.plates[0] / TAKEN.plates[0]
        assert more == (room > TAKEN.total)

    def test_the_size_that_they_take(self) -> None:
        assert for_size(TAKEN.total).crf == pytest.approx(TAKEN.crf, abs=0.01)
        less = for_size(TAKEN.total, quick=True)
        assert less.crf < TAKEN.crf - 0.1

    def test_budgets(self) -> None:
        sizes = Sizes(26.0, TAKEN.plates, TAKEN.others, TAKEN.predicted)
        budgets = sizes.budgets([Budget(5), Budget(6), Budget(7)])
        assert budgets == [
            Budget(5, bytes=10_000, plate_bytes=60_000),
            Budget(6, bytes=20_000, predicted=True),
            Budget(7, bytes=30_000, predicted=True),
        ]


class TestQualities:
    @given(st.floats(25.0, 50.0))
    def test_for_a_psnr(self, wanted: float) -> None:
        """All GOPs are better or worse by as much."""
        goal = PsnrGoal(wanted, (8, 8, 16))
        found = goal.plan(TAKEN, quick=False)
        assert np.average(found.psnrs, weights=goal.frames) == pytest.approx(wanted)
        assert np.ptp(np.subtract(found.psnrs, TAKEN.psnrs)) < 1e-9
        assert 0 <= found.crf <= CRF.highest
        assert (found.crf < TAKEN.crf) == (goal.miss(TAKEN, quick=False) < 0)

    def test_more_effort_is_better(self) -> None:
        goal = PsnrGoal(36.0, (8, 8, 16))
        usual, more = (goal.plan(TAKEN, quick=quick) for quick in (False, True))
        assert more.crf == pytest.approx(usual.crf + PSNR.effort / PSNR.crf_step)
        assert more.psnrs == usual.psnrs

    def test_budgets(self) -> None:
        slope = Slope(2.0, 500)
        qualities = Qualities(30.0, (33.0, 34.0), (False, True))
        assert qualities.budgets([Budget(5, slope), Budget(6, slope)]) == [
            Budget(5, Quality(33.0, slope)),
            Budget(6, Quality(34.0, slope), predicted=True),
        ]


class TestFirstPass:
    found: Sizes

    def passes(
        self, guess: float, power: float, plate: int = 0, **settings: Any
    ) -> list[EncodeSettings]:
        """Return the passes for the half of what a film takes at CRF 26, but for a plate."""
        asked: list[EncodeSettings] = []

        def measure(settings: EncodeSettings) -> Taken:
            asked.append(settings)
            assert settings.crf is not None
            size = round(100_000 * qscale_of(settings.crf) ** -power)
            return Taken(settings.crf, (plate,), (size,), (38.0,), (False,))

        goal = SizeGoal(50_000)
        self.found = first_pass(EncodeSettings(bpp=1.0, **settings), guess, goal, measure)
        assert self.found.total == pytest.approx(50_000, abs=2)
        return asked

    def test_one_suffices_near_the_size(self) -> None:
        (quick,) = self.passes(28.0, SIZE.power)
        assert (quick.crf, quick.bpp, quick.preset) == (28.0, None, "fastest")

    @pytest.mark.parametrize("guess", [20.0, 40.0])
    def test_another_where_the_guess_was_wrong(self, guess: float) -> None:
        first, second = self.passes(guess, 1.4)
        assert first.crf == guess
        assert second.crf is not None
        assert abs(second.crf - 29.4) < 3.5

    def test_plates_are_met_more_nearly(self) -> None:
        *_, last = self.passes(20.0, 1.4, plate=5_000)
        assert last.crf is not None
        assert abs(self.found.crf - last.crf) < SIZE.near_plates
        # One of 20 000 bytes, whatever the quality, is never met.
        assert len(self.passes(20.0, 0.2, plate=20_000)) == SIZE.passes_plates

    def test_between_two_that_miss_by_far(self) -> None:
        """Plates that fall twice as fast as foreseen: the third pass goes by both before."""
        asked: list[float] = []

        def measure(settings: EncodeSettings) -> Taken:
            assert settings.crf is not None
            asked.append(settings.crf)
            plate = round(60_000 * qscale_of(asked[-1]) ** -1.3)
            return Taken(asked[-1], (plate,), (300,), (36.0,), (False,))

        settings = EncodeSettings(bpp=1.0, preset="fastest")
        found = first_pass(settings, 26.0, SizeGoal(12_000), measure)
        assert len(asked) == SIZE.passes_plates
        assert asked[0] < asked[2] < asked[1]
        assert measure(settings.at_quality(found.crf)).total == pytest.approx(12_000, rel=0.05)

    @pytest.mark.parametrize(("preset", "gain"), [("fastest", 0.0), ("medium", PSNR.effort)])
    def test_for_a_psnr(self, preset: Any, gain: float) -> None:
        """A film loses twice the dB a CRF that are foreseen."""
        settings = EncodeSettings(target_psnr=36.0, preset=preset)
        asked: list[float] = []

        def measure(settings: EncodeSettings) -> Taken:
            assert settings.target_psnr is None
            assert settings.preset == "fastest"
            assert settings.crf is not None
            asked.append(settings.crf)
            psnr = 40.0 - 2 * PSNR.crf_step * (settings.crf - 24.0) - gain
            return Taken(settings.crf, (0,), (5000,), (psnr,), (False,))

        found = first_pass(settings, 20.0, PsnrGoal(36.0, (9,)), measure)
        assert found.psnrs == (36.0,)
        assert asked == [20.0, 36.0]
        assert found.crf == pytest.approx(28.0)  # between the two

    def test_it_takes_a_part_of_the_time(self) -> None:
        (quick,) = self.passes(28.0, SIZE.power, time_budget=2.0)
        assert quick.time_budget == 2 * SIZE.time
        for guess, power in (20.0, 0.2), (40.0, 2.0):  # it is not believed all the way
            (quick,) = self.passes(guess, power, time_budget=2.0)
            assert abs(self.found.crf - guess) == pytest.approx(SIZE.near)
        (quick,) = self.passes(28.0, SIZE.power, preset="slow")
        assert quick.preset == "medium"
