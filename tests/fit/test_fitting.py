"""One fit: what it returns, and what is left of its effort for tuning."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gsvrcodec.fit.fitting import Allowance, Fit, fit_gop, mean_psnr
from gsvrcodec.fit.footage import Footage
from gsvrcodec.fit.paper import fit_as_published
from gsvrcodec.fit.recipe import FitOptions
from gsvrcodec.fit.target import Slope
from gsvrcodec.fit.tuned import EFFORT, STAGED
from gsvrcodec.model.gop import Gop
from gsvrcodec.model.static import append_gaussians
from gsvrcodec.render import render_frames
from tests import making
from tests.fit.synthetic import BACKEND, assert_finite, footage, moving_texture, sample

SIZE = (64, 48)
GRID = (4, 3, 4)


@pytest.fixture(scope="module")
def shots() -> Footage:
    return footage(sample(making.BUNNY_SMALL, SIZE, 4))


def fitted(
    shots: Footage,
    options: FitOptions | None = None,
    allowance: Allowance | None = None,
    *,
    gaussians: int = 100,
    seed: int = 0,
    fit: Callable[..., Fit] = fit_gop,
) -> Fit:
    chosen, effort = options or FitOptions(), allowance or Allowance(150, None)
    grid = (0, 0, 0) if chosen.deform == "polynomial" else GRID
    return fit(shots, gaussians, grid, chosen, effort, BACKEND, seed=(seed, 7))


class TestFit:
    def test_quality_is_that_of_the_gaussians(self, shots: Footage) -> None:
        found = fitted(shots)
        assert_finite(found.gop)
        assert len(found.gop) == 100
        assert found.gop.xy.shape == (3, 4, 8)
        assert found.psnr == mean_psnr(found.gop, shots, BACKEND)
        assert found.psnr > 22

    def test_same_seed_same_fit(self, shots: Footage) -> None:
        one, again, other = (fitted(shots, seed=seed) for seed in (1, 1, 2))
        for name in Gop.__slots__:
            np.testing.assert_array_equal(getattr(one.gop, name), getattr(again.gop, name))
        assert not np.array_equal(one.gop.position, other.gop.position)

    def test_their_number_follows_a_slope(self, shots: Footage) -> None:
        options, effort = FitOptions(), Allowance(150, None)
        counts = []
        for slope in (Slope(1.0, 500), Slope(4.0, 500), Slope(1.0, 500, lasting=3.0), None):
            found = fit_gop(shots, 100, GRID, options, effort, BACKEND, seed=(0, 7), slope=slope)
            assert_finite(found.gop)
            assert found.psnr == mean_psnr(found.gop, shots, BACKEND)
            counts.append(len(found.gop))
        usual, coarse, lasting, fixed = counts
        assert 1 <= coarse < usual / 2 < usual < lasting <= 500
        assert fixed == 100

    def test_what_is_kept_behind_is_not_part_of_it(self) -> None:
        film = moving_texture(3, (1, 0), SIZE)
        behind = fitted(
            footage(film[1:2]), FitOptions(deform="polynomial"), Allowance(300, None), gaussians=300
        ).gop
        behind = replace(
            behind,
            indicator=np.ones_like(behind.indicator),
            linear=np.zeros_like(behind.linear),
            quadratic=np.zeros_like(behind.quadratic),
        )
        alone = fitted(footage(film), gaussians=30)
        in_front = fitted(footage(film, behind), gaussians=30)
        assert len(in_front.gop) == 30
        assert in_front.psnr > alone.psnr + 2

    def test_the_publication_s_profile_starts_at_random(self, shots: Footage) -> None:
        paper, main = (fitted(shots, fit=fit) for fit in (fit_as_published, fit_gop))
        assert_finite(paper.gop)
        assert main.psnr > paper.psnr + 1


class TestEffort:
    def test_a_share_is_left_for_tuning(self, shots: Footage) -> None:
        found = fitted(shots, allowance=Allowance(400, None))
        assert found.steps == round((1 - STAGED.effort) * 400)
        assert found.tuning == Allowance(round(STAGED.effort * 400), None)

    @pytest.mark.parametrize(
        "settings",
        [{"options": FitOptions(tune=False)}, {"fit": fit_as_published}],
        ids=["main", "paper"],
    )
    def test_all_of_it_where_nothing_is_tuned(
        self, shots: Footage, settings: dict[str, Any]
    ) -> None:
        found = fitted(shots, **settings)
        assert found.steps == 150
        assert found.tuning is None

    def test_there_is_a_least(self, shots: Footage) -> None:
        found = fitted(shots, allowance=Allowance(1, None))
        assert found.steps == EFFORT.least_steps
        assert found.tuning == Allowance(EFFORT.least_tuning_steps, None)

    def test_a_wall_time_is_shared(self, shots: Footage) -> None:
        found = fitted(shots, allowance=Allowance(10**9, 2.0))
        assert 10 < found.steps < 10**9
        assert found.tuning is not None
        assert found.tuning.seconds is not None
        assert 0.1 <= found.tuning.seconds <= STAGED.effort * 2.0

    def test_no_time_left(self, shots: Footage) -> None:
        found = fitted(shots, allowance=Allowance(10**9, -5.0))
        assert_finite(found.gop)
        assert found.tuning == Allowance(round(STAGED.effort * 10**9), 0.1)


class TestMeanPsnr:
    @pytest.mark.parametrize("frames", [1, EFFORT.measured_frames, EFFORT.measured_frames + 3])
    def test_any_number_of_frames(self, frames: int) -> None:
        shots = footage(sample(making.NOISE, (40, 32), frames))
        gop = making.random_gop(np.random.default_rng(0))
        shown = render_frames(gop, shots.taus, shots.size, shots.size)
        values = [making.psnr(a, b) for a, b in zip(shots.frames, shown, strict=True)]
        assert mean_psnr(gop, shots, BACKEND) == pytest.approx(np.mean(values))

    def test_what_is_kept_is_behind(self) -> None:
        front, behind = (
            making.random_gop(np.random.default_rng(seed), 20, (0, 0, 0)) for seed in (1, 2)
        )
        frames = sample(making.NOISE, (40, 32), 2)
        assert mean_psnr(front, footage(frames, behind), BACKEND) == mean_psnr(
            append_gaussians(front, behind), footage(frames), BACKEND
        )
