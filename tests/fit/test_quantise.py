"""One fit at any qscale: its size, its quality, and what is stored of it."""

from __future__ import annotations

import inspect
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gsvrcodec.fit import quantise as module
from gsvrcodec.fit.fitting import Allowance, fit_gop, mean_psnr
from gsvrcodec.fit.paper import as_published
from gsvrcodec.fit.precision import refined_steps, usual_qscale, with_static, with_usual_opacity
from gsvrcodec.fit.quantise import Quantised, QuantisedFit, quantisable
from gsvrcodec.fit.recipe import FitOptions
from gsvrcodec.fit.search import Candidate
from gsvrcodec.model.gop import Gop
from gsvrcodec.model.quantise import PAPER_BITS, Precision, Refined, dequantised
from tests import making
from tests.fit.synthetic import BACKEND, footage, sample

SIZE = (96, 64)


def measure(gop: Gop, precision: Precision, exact: bool) -> int:
    """Sum of the codes' ranges: bytes, or so; a quick measure is 100 more."""
    steps = [own.steps if isinstance(own, Refined) else own for own in precision.values()]
    codes = sum(int(1 / step) for own in steps for step in np.atleast_1d(own))
    return codes + int((gop.indicator < 1).sum()) + 100 * (not exact)


@pytest.fixture(scope="module")
def fit() -> QuantisedFit:
    shots = footage(sample(making.BUNNY_SMALL, SIZE, 4))
    options = FitOptions()
    found = fit_gop(shots, 250, (5, 4, 4), options, Allowance(400, None), BACKEND, seed=(0, 0))
    return quantisable(found, options, BACKEND, measure, seed=(0, 0))


def untuned(fit: QuantisedFit) -> QuantisedFit:
    return replace(fit, fit=replace(fit.fit, tuning=None))


def test_it_is_a_candidate(fit: QuantisedFit) -> None:
    candidate: Candidate[Quantised] = fit
    assert candidate.psnr == fit.fit.psnr
    assert candidate.usual_qscale == usual_qscale(4 * 96 * 64, 250, fit.psnr)


def test_size(fit: QuantisedFit) -> None:
    sizes = [fit.size(qscale) for qscale in (0.2, 1.0, 5.0)]
    assert sizes == sorted(sizes, reverse=True)
    assert fit.size(1.0) - fit.size(1.0, exact=True) == 100


def test_quality_falls_with_the_qscale(fit: QuantisedFit) -> None:
    values = [fit.quality(qscale) for qscale in (0.1, 1.0, 4.0, 16.0)]
    assert values == sorted(values, reverse=True)
    assert values[0] > fit.psnr - 0.2
    assert fit.quality(fit.usual_qscale) > fit.psnr - 0.6


class TestQuantised:
    def test_quality_is_what_a_decoder_shows(self, fit: QuantisedFit) -> None:
        stored = fit.quantised(2.0)
        gop = with_static(fit.fit.gop, [fit.sensitivities], 2.0)
        gop = with_usual_opacity(gop, np.ones(len(gop), np.bool_), fit.sensitivities, 2.0)
        assert stored.precision == refined_steps(gop, fit.sensitivities, 2.0)
        shown = dequantised(stored.gop, stored.precision)
        assert stored.psnr == mean_psnr(shown, fit.fit.footage, BACKEND)

    def test_tuning_wins_back_a_part_of_the_loss(self, fit: QuantisedFit) -> None:
        qscale = 3 * fit.usual_qscale
        before, after = fit.quality(qscale), fit.quantised(qscale).psnr
        assert before < fit.psnr - 0.3
        assert after > before + 0.1 * (fit.psnr - before)

    def test_without_tuning_it_is_rounded_alone(self, fit: QuantisedFit) -> None:
        bare = untuned(fit)
        assert bare.quantised(2.0).psnr == bare.quality(2.0) == fit.quality(2.0)

    def test_same_qscale_same_values(self, fit: QuantisedFit) -> None:
        one, again = fit.quantised(2.0), fit.quantised(2.0)
        for name in Gop.__slots__:
            np.testing.assert_array_equal(getattr(one.gop, name), getattr(again.gop, name))

    def test_what_hardly_moves_is_static(self, fit: QuantisedFit) -> None:
        static = [
            int((untuned(fit).quantised(qscale).gop.indicator == 1).sum()) for qscale in (0.1, 16.0)
        ]
        assert static[0] < static[1]

    def test_what_hardly_shows_of_opacities_is_left_out(self, fit: QuantisedFit) -> None:
        usual = [
            int((untuned(fit).quantised(qscale).gop.log_opacity == 0).sum())
            for qscale in (0.1, 16.0)
        ]
        assert usual[0] < usual[1]

    @pytest.mark.parametrize("trials", [1, 3])
    def test_trials_share_a_wall_time(
        self, fit: QuantisedFit, monkeypatch: pytest.MonkeyPatch, trials: int
    ) -> None:
        seen: list[float | None] = []
        signature = inspect.signature(module.quantise_in_stages)

        def staged(gop: Gop, *arguments: Any, **named: Any) -> Gop:
            seen.append(signature.bind(gop, *arguments, **named).arguments["seconds"])
            return gop

        monkeypatch.setattr(module, "quantise_in_stages", staged)
        timed = replace(fit, fit=replace(fit.fit, tuning=Allowance(50, 6.0)))
        timed.quantised(1.0, trials=trials)
        fit.quantised(1.0, trials=trials)
        assert seen == [6.0 / trials, None]


def test_as_published(fit: QuantisedFit) -> None:
    stored = as_published(fit.fit, BACKEND)
    assert stored.gop is fit.fit.gop
    assert stored.precision == PAPER_BITS
    assert stored.psnr == mean_psnr(dequantised(stored.gop, PAPER_BITS), fit.fit.footage, BACKEND)
    assert fit.psnr - 1 < stored.psnr <= fit.psnr + 0.1
