"""Rate control against a made-up fit, whose sizes and qualities are formulas."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gsvrcodec.fit.search import (
    Candidate,
    fit_to_psnr,
    quantise_to_psnr,
    quantise_to_size,
)
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
    left: float | None = 0.5  #: fraction of the loss left after tuning; None = it does not tune
    scale: float = 20_000.0  #: bytes at qscale 1, or so
    slope: float = 0.6  #: size falls as qscale**-slope
    share: float = 0.0  #: what the quick choice of codecs takes more: a fraction of the size,
    more: int = 0  #: and bytes
    added: float = 0.0  #: what tuning adds to a size: a fraction of it
    exact: list[float] = field(default_factory=list)  #: qscales whose size was asked for exactly
    trials: list[int] = field(default_factory=list)  #: of each quantisation

    @property
    def is_tuned(self) -> bool:
        return self.left is not None

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
        left = 1.0 if self.left is None else self.left
        psnr = self.psnr - left * (self.psnr - self.quality(qscale))
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
        usual=st.floats(FINEST, COARSEST),
    )
    def test_it_is_met_after_tuning(
        self, loss: float, left: float, psnr: float, usual: float
    ) -> None:
        candidate = MadeUp(psnr, usual, left)
        stored = quantise_to_psnr(candidate, psnr - loss)
        assert stored.psnr == pytest.approx(psnr - loss, abs=RATE_CONTROL.near)
        assert 1 <= len(candidate.trials) <= RATE_CONTROL.tunings
        assert set(candidate.trials) == {RATE_CONTROL.tunings}

    @given(loss=st.floats(0.1, 12.0), usual=st.floats(FINEST, COARSEST))
    def test_it_is_met_without_tuning(self, loss: float, usual: float) -> None:
        candidate = MadeUp(usual_qscale=usual, left=None)
        stored = quantise_to_psnr(candidate, 40 - loss)
        assert stored.psnr == pytest.approx(40 - loss, abs=0.03)
        assert candidate.trials == [1]

    def test_the_last_trials_lie_between(self) -> None:
        class Uneven(MadeUp):
            """Tuning wins more back where steps are finer."""

            def quantised(self, qscale: float, *, trials: int = 1) -> Stored:
                found.append(qscale)
                kind = replace(self, left=0.9 if qscale > 2 else 0.3)
                return MadeUp.quantised(kind, qscale, trials=trials)

        found: list[float] = []
        quantise_to_psnr(Uneven(), 37.0)
        assert max(found) > 2 > min(found)
        assert min(found[:2]) <= found[2] <= max(found[:2])

    def test_the_usual_loss_takes_one_trial(self) -> None:
        candidate = MadeUp(left=RATE_CONTROL.loss_left)
        quantise_to_psnr(candidate, 39.0)
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
        stored = quantise_to_psnr(Fickle(), 37.0)
        assert len(found) == RATE_CONTROL.tunings
        assert found[-1] > min(found)
        assert abs(stored.psnr - 37.0) == min(found)

    @pytest.mark.parametrize("left", [None, 0.5])
    @pytest.mark.parametrize(("psnr", "end"), [(41.0, FINEST), (40.0, FINEST), (1.0, COARSEST)])
    def test_out_of_reach(self, psnr: float, end: float, left: float | None) -> None:
        stored = quantise_to_psnr(MadeUp(left=left), psnr)
        assert stored.qscale == pytest.approx(end)


@dataclass(frozen=True)
class Made:
    """A fit by its number of Gaussians."""

    gaussians: int
    psnr: float
    steps: float


@dataclass
class Fits:
    """Fits that cost nothing, and which of them were asked for."""

    base: float = 30.0  #: dB of a thousand Gaussians after steps without end
    octave: float = RATE_CONTROL.octave  #: dB gained by twice as many
    steps: float = 1200.0  #: of a whole fit
    asked: list[tuple[int, float]] = field(default_factory=list)

    def __call__(self, gaussians: int, share: float) -> Made:
        self.asked.append((gaussians, share))
        steps = share * self.steps
        scale, power = RATE_CONTROL.deficit
        missing = scale * steps**power if share < 1 else 0.0
        psnr = self.base + self.octave * math.log2(gaussians / 1000) - missing
        return Made(gaussians, psnr, steps)


def spare_of(found: Made, target_psnr: float) -> float:
    return found.psnr - target_psnr - RATE_CONTROL.rounding_loss


class TestGaussians:
    @given(
        octave=st.floats(1.5, 3.2),
        target=st.floats(24.0, 37.0),
        steps=st.floats(300.0, 30_000.0),
    )
    def test_a_fit_that_suits_is_found(self, octave: float, target: float, steps: float) -> None:
        fits = Fits(octave=octave, steps=steps)
        found = fit_to_psnr(fits, target, 1000, 10**7)
        low, high = RATE_CONTROL.spare
        assert low <= spare_of(found, target) <= high
        assert fits.asked[0] == (1000, RATE_CONTROL.pilot)
        assert {share for _, share in fits.asked[1:]} == {1.0}
        assert found.gaussians == fits.asked[-1][0]

    @given(
        base=st.floats(5.0, 60.0),
        octave=st.floats(-1.0, 9.0),
        target=st.floats(10.0, 60.0),
        first=st.integers(1, 10**5),
        most=st.integers(1, 10**5),
        refits=st.integers(0, 5),
    )
    def test_it_ends_within_its_refits_and_bounds(
        self, base: float, octave: float, target: float, first: int, most: int, refits: int
    ) -> None:
        fits = Fits(base, octave)
        found = fit_to_psnr(fits, target, min(first, most), most, refits=refits)
        assert 2 <= len(fits.asked) <= 2 + refits
        assert all(1 <= gaussians <= most for gaussians, _ in fits.asked)
        assert (found.gaussians, 1.0) == fits.asked[-1]

    def test_a_pilot_that_foretells_it_is_enough(self) -> None:
        fits = Fits()
        found = fit_to_psnr(fits, 33.0, 1000, 10**7)
        assert len(fits.asked) == 2
        assert spare_of(found, 33.0) == pytest.approx(sum(RATE_CONTROL.spare) / 2, abs=0.02)

    @pytest.mark.parametrize("octave", [0.5, 2.3, 6.0])
    def test_without_refits_the_first_whole_fit_stays(self, octave: float) -> None:
        fits = Fits(octave=octave)
        found = fit_to_psnr(fits, 36.0, 1000, 10**7, refits=0)
        assert [share for _, share in fits.asked] == [RATE_CONTROL.pilot, 1.0]
        assert found.gaussians == fits.asked[1][0]

    def test_the_usual_refits_are_bounded(self) -> None:
        fits = Fits(octave=0.0)  # more Gaussians never help
        fit_to_psnr(fits, 36.0, 1000, 10**9)
        assert len(fits.asked) == 2 + RATE_CONTROL.refits

    def test_as_many_as_may_be_when_it_is_out_of_reach(self) -> None:
        fits = Fits()
        assert fit_to_psnr(fits, 90.0, 1000, 3000).gaussians == 3000
        assert fits.asked[1:] == [(3000, 1.0)]

    def test_one_when_it_is_too_easy(self) -> None:
        fits = Fits()
        assert fit_to_psnr(fits, 3.0, 20, 3000).gaussians == 1
