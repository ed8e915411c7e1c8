"""Rate control against a made-up fit, whose sizes and qualities are formulas."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gsvrcodec.fit.search import Candidate, Goal, find_qscale, quantise_to_psnr, quantise_to_size
from gsvrcodec.fit.target import Quality, Slope
from gsvrcodec.fit.tuned import RATE_CONTROL

FINEST, COARSEST = RATE_CONTROL.finest, RATE_CONTROL.coarsest


@dataclass(frozen=True)
class Stored:
    """A quantised fit."""

    psnr: float
    bytes: int
    qscale: float


@dataclass(frozen=True)
class MadeUp:
    """A fit that costs nothing; implements `Candidate`."""

    psnr: float = 40.0
    usual_qscale: float = 1.0
    left: float = 0.5  #: fraction of the loss left after tuning
    scale: float = 20_000.0  #: bytes at qscale 1, or so
    slope: float = 0.6  #: size falls as qscale**-slope
    share: float = 0.0  #: what the quick choice of codecs takes more: a fraction of the size,
    more: int = 0  #: and bytes
    added: float = 0.0  #: what tuning adds to a size: a fraction of it
    exact: list[float] = field(default_factory=list)  #: qscales whose size was asked for exactly
    trials: list[int] = field(default_factory=list)  #: of each quantisation

    def bytes(self, qscale: float) -> int:
        return int(self.scale * (math.pow(qscale, -self.slope) + 0.1))

    def size(self, qscale: float, *, exact: bool = False) -> int:
        size = self.bytes(qscale)
        if exact:
            self.exact.append(qscale)
            return size
        return size + int(self.share * size) + self.more

    def quality(self, qscale: float) -> float:
        return self.psnr - 10 * math.log10(1 + qscale**2)

    def quantised(self, qscale: float, *, trials: int = 1) -> Stored:
        self.trials.append(trials)
        psnr = self.psnr - self.left * (self.psnr - self.quality(qscale))
        return Stored(psnr, int((1 + self.added) * self.bytes(qscale)), qscale)

    def stored_bytes(self, result: Stored) -> int:
        return result.bytes


def test_it_is_a_candidate() -> None:
    candidate: Candidate[Stored] = MadeUp()
    assert candidate.quantised(1.0).psnr > candidate.quality(1.0)


class TestSize:
    @given(
        scale=st.floats(2e3, 1e6),
        slope=st.floats(0.2, 1.5),
        answer=st.floats(0.15, 10.0),
        usual=st.floats(FINEST, COARSEST),
        share=st.floats(0.0, 0.05),
        more=st.integers(0, 500),
        begin=st.floats(FINEST, COARSEST),
    )
    def test_it_is_met_from_below(
        self,
        scale: float,
        slope: float,
        answer: float,
        usual: float,
        share: float,
        more: int,
        begin: float,
    ) -> None:
        candidate = MadeUp(scale=scale, slope=slope, usual_qscale=usual, share=share, more=more)
        wanted = candidate.bytes(answer)
        stored = quantise_to_size(candidate, wanted, begin)
        assert stored.bytes <= wanted
        least = RATE_CONTROL.finest_usual * usual
        assert stored.bytes >= 0.97 * min(wanted, candidate.bytes(least)) - 4
        assert stored.qscale >= least
        assert candidate.trials == [1]

    def test_what_the_quick_choice_takes_more_is_used(self) -> None:
        candidate = MadeUp(more=4000)
        stored = quantise_to_size(candidate, 20_000, 1.0)
        assert 0.99 * 20_000 < stored.bytes <= 20_000
        assert len(candidate.exact) == 1

    def test_room_is_left_for_tuning(self) -> None:
        stored = quantise_to_size(MadeUp(), 20_000, 1.0)
        assert stored.bytes <= (1 - RATE_CONTROL.size_room) * 20_000 + 1

    @pytest.mark.parametrize("added", [0.002, 0.01, 0.05])
    def test_what_tuning_adds_is_made_up_for(self, added: float) -> None:
        candidate = MadeUp(added=added, share=0.02)
        stored = quantise_to_size(candidate, 20_000, 1.0)
        assert 0.98 * 20_000 < stored.bytes <= 20_000
        assert len(candidate.trials) == 1 + (added > RATE_CONTROL.size_room)

    @pytest.mark.parametrize(("size", "end"), [(10**9, 0.5), (1, COARSEST)])
    def test_out_of_reach(self, size: int, end: float) -> None:
        candidate = MadeUp(share=0.02, added=0.05)
        assert quantise_to_size(candidate, size, 1.0).qscale == pytest.approx(end)
        assert candidate.trials == [1]


class TestQuality:
    @given(
        loss=st.floats(0.1, 5.0),
        left=st.floats(0.3, 1.0),
        psnr=st.floats(20.0, 50.0),
        off=st.floats(1 / 1.5, 1.5),
    )
    def test_it_is_met_after_tuning(
        self, loss: float, left: float, psnr: float, off: float
    ) -> None:
        """From a qscale that is not far from the right one."""
        candidate = MadeUp(psnr, left=left)
        right = find_qscale(candidate.quality, Goal.of_psnr(psnr - loss / left), 1.0)
        first = min(max(off * right, FINEST), COARSEST)
        stored = quantise_to_psnr(candidate, psnr - loss, first)
        if FINEST < right < COARSEST:
            assert stored.psnr == pytest.approx(psnr - loss, abs=RATE_CONTROL.near)
        assert 1 <= len(candidate.trials) <= RATE_CONTROL.tunings
        assert set(candidate.trials) == {RATE_CONTROL.tunings}

    @given(loss=st.floats(0.1, 12.0), off=st.floats(1 / 1.5, 1.5))
    def test_it_is_met_without_tuning(self, loss: float, off: float) -> None:
        candidate = MadeUp(left=1.0)
        right = find_qscale(candidate.quality, Goal.of_psnr(40 - loss), 1.0)
        stored = quantise_to_psnr(candidate, 40 - loss, off * right)
        assert stored.psnr == pytest.approx(40 - loss, abs=RATE_CONTROL.near)

    def test_the_last_trials_lie_between(self) -> None:
        class Uneven(MadeUp):
            """Tuning wins more back where steps are finer."""

            def quantised(self, qscale: float, *, trials: int = 1) -> Stored:
                found.append(qscale)
                kind = replace(self, left=0.9 if qscale > 2 else 0.3)
                return MadeUp.quantised(kind, qscale, trials=trials)

        found: list[float] = []
        quantise_to_psnr(Uneven(), 37.0, 2.5)
        assert max(found) > 2 > min(found)
        assert min(found[:2]) <= found[2] <= max(found[:2])

    def test_the_right_one_takes_one_trial(self) -> None:
        candidate = MadeUp(left=0.5)
        right = find_qscale(candidate.quality, Goal.of_psnr(38.0), 1.0)
        quantise_to_psnr(candidate, 39.0, right)
        assert len(candidate.trials) == 1

    def test_the_nearest_trial_is_returned(self) -> None:
        class Fickle(MadeUp):
            """Of each trial another fraction of the loss is left."""

            def quantised(self, qscale: float, *, trials: int = 1) -> Stored:
                kind = replace(self, left=(0.55, 0.6, 0.62, 0.2)[len(self.trials)])
                stored = MadeUp.quantised(kind, qscale, trials=trials)
                found.append(abs(stored.psnr - 37.0))
                return stored

        found: list[float] = []
        stored = quantise_to_psnr(Fickle(), 37.0, 1.5)
        assert len(found) == RATE_CONTROL.tunings
        assert found[-1] > min(found)
        assert abs(stored.psnr - 37.0) == min(found)

    @pytest.mark.parametrize("qscale", [FINEST, 1.0, COARSEST])
    @pytest.mark.parametrize(("psnr", "finer"), [(41.0, True), (40.0, True), (1.0, False)])
    def test_out_of_reach(self, psnr: float, finer: bool, qscale: float) -> None:
        """It is not paid for by steps that are finer, or coarser, without end."""
        candidate = MadeUp(left=0.5)
        stored = quantise_to_psnr(candidate, psnr, qscale)
        end = max(FINEST, qscale / RATE_CONTROL.reach)
        if not finer:
            end = min(COARSEST, qscale * RATE_CONTROL.reach)
        assert stored.qscale == pytest.approx(end)
        assert len(candidate.trials) <= 2

    @given(psnr=st.floats(30.0, 45.0))
    def test_a_finer_slope_where_a_fit_falls_short(self, psnr: float) -> None:
        target = Quality(38.0, Slope(2.0, 500))
        finer = target.finer(psnr)
        needed = 38 + RATE_CONTROL.rounding
        if psnr >= needed:
            assert finer is None
        else:
            assert finer is not None
            assert finer.psnr == 38
            gained = RATE_CONTROL.octave * math.log2(2.0 / finer.slope.qscale)
            missing = needed - psnr + RATE_CONTROL.spare
            assert finer.slope.qscale == FINEST or gained == pytest.approx(missing)
