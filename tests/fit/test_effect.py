"""What each Gaussian does for the picture: about what changes when it is taken out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from gsvrcodec.fit.footage import Frames
from gsvrcodec.fit.precision import still
from gsvrcodec.fit.relocate import effects, losses, sums_at
from gsvrcodec.model.gop import Float32Array, Gop
from gsvrcodec.model.static import append_gaussians, select_gaussians, static_gop
from tests.fit.synthetic import BACKEND, footage

SIZE = WIDTH, HEIGHT = 64, 48
NOW = np.zeros(1, np.float32)


def covering() -> Gop:
    """One grey Gaussian that covers the frame."""
    middle, none = np.zeros((1, 2), np.float32), np.zeros(1, np.float32)
    grey = np.full((1, 3), 0.5, np.float32)
    return static_gop(middle, np.full((1, 2), 8, np.float32), none, grey, none)


def crowd(gaussians: int = 80, seed: int = 1) -> Gop:
    """Gaussians of several sizes and opacities, more than one at most places."""
    draw = np.random.default_rng(seed)
    arrays = (
        draw.uniform(-0.9, 0.9, (gaussians, 2)),
        draw.uniform(0.7, 1.9, (gaussians, 2)),
        draw.uniform(0, np.pi, gaussians),
        draw.uniform(0.1, 0.9, (gaussians, 3)),
        draw.normal(0, 0.7, gaussians),
    )
    return static_gop(*(array.astype(np.float32) for array in arrays))


def picture(gop: Gop) -> Float32Array:
    return BACKEND.picture(BACKEND.prepare(gop), 0.0, SIZE, SIZE)


def without(gop: Gop, number: int) -> Gop:
    return select_gaussians(gop, np.arange(len(gop)) != number)


def changes(gop: Gop, behind: Gop) -> NDArray[np.float64]:
    """Squared change of the picture without each Gaussian, over all pixels."""
    whole = picture(append_gaussians(gop, behind))
    rest = (picture(append_gaussians(without(gop, n), behind)) for n in range(len(gop)))
    return np.array([float(np.square(one - whole, dtype=np.float64).sum()) for one in rest])


def ranks(values: NDArray[np.float64]) -> NDArray[np.intp]:
    return values.argsort().argsort()


def effects_of(gop: Gop, behind: Gop) -> NDArray[np.float64]:
    drawn = append_gaussians(gop, behind)
    return effects(gop, sums_at(drawn, NOW, SIZE, SIZE, BACKEND), SIZE, BACKEND)


def losses_of(gop: Gop, frames: Frames, behind: Gop | None) -> NDArray[np.float64]:
    return losses(gop, footage(frames, behind), BACKEND)


class TestEffects:
    def test_they_are_the_change(self) -> None:
        gop, behind = crowd(), covering()
        found, true = effects_of(gop, behind), changes(gop, behind)
        assert np.corrcoef(ranks(found), ranks(true))[0, 1] > 0.995
        np.testing.assert_allclose(found, true, rtol=0.25)
        assert found.sum() == pytest.approx(true.sum(), rel=0.05)

    def test_in_the_colour_of_the_picture_there_is_none(self) -> None:
        gop, behind = crowd(1), covering()
        gop.colour[:] = behind.colour
        assert effects_of(gop, behind)[0] < 1e-4
        gop.colour[0, 1] += 0.2
        assert effects_of(gop, behind)[0] > 0.01

    def test_outside_of_the_frame_there_is_none(self) -> None:
        gop = crowd(4)
        gop.position[:] = (2.5, 0), (0, -2.5), (1.01, 0), (0, -0.99)
        assert (effects_of(gop, covering()) > 0).tolist() == [False, False, True, True]

    def test_at_another_time_it_may_be_inside(self) -> None:
        gop = crowd(2)
        gop.position[:] = -1.5, 0.0
        gop.linear[1] = 0.8, 0.0
        taus = np.array([-1, 0, 1], np.float32)
        drawn = append_gaussians(gop, covering())
        found = effects(gop, sums_at(drawn, taus, SIZE, SIZE, BACKEND), SIZE, BACKEND)
        assert (found > 0).tolist() == [False, True]

    def test_what_is_alone_counts_most(self) -> None:
        """Nothing stands in for it; another one in the same place does."""
        gop = crowd(3)
        gop.position[:] = (-0.5, 0), (0.5, 0), (0.5, 0)
        gop.log_scale[:], gop.log_opacity[:], gop.colour[:] = 1.0, 0.0, 0.7
        found = effects(gop, sums_at(gop, NOW, SIZE, SIZE, BACKEND), SIZE, BACKEND)
        assert found[0] > 100 * found[1:].max()


class TestLosses:
    @pytest.mark.parametrize("behind", [False, True])
    def test_they_are_the_errors_without_each(self, behind: bool) -> None:
        """Of a picture that the Gaussians meet, in front of others or not."""
        gop, others = crowd(), covering()
        whole = append_gaussians(gop, others)
        codes = np.clip(255 * picture(whole), 0, 255).astype(np.uint8)
        true = changes(gop, others) * (255**2 / 3)
        if behind:
            found = losses_of(gop, codes[None], others)
        else:
            found = losses_of(whole, codes[None], None)[:-1]
        assert np.corrcoef(ranks(found), ranks(true))[0, 1] > 0.995
        np.testing.assert_allclose(found, true, rtol=0.25)
        assert found.sum() == pytest.approx(true.sum(), rel=0.05)

    def test_they_add_up_over_the_frames(self) -> None:
        gop, behind = still(crowd()), covering()
        blank = np.zeros((1, HEIGHT, WIDTH, 3), np.uint8)
        one, four = (losses_of(gop, blank.repeat(n, axis=0), behind).sum() for n in (1, 4))
        assert four == pytest.approx(4 * one, rel=0.2)

    def test_in_the_colour_of_the_picture_there_is_none(self) -> None:
        gop, behind = crowd(1), covering()
        blank = np.zeros((1, HEIGHT, WIDTH, 3), np.uint8)
        same = replace(gop, colour=behind.colour.copy())
        assert losses_of(same, blank, behind)[0] < 1e-3 * losses_of(gop, blank, behind)[0]

    def test_outside_of_the_frame_there_is_none(self) -> None:
        gop, behind = crowd(2), covering()
        gop.position[:] = (3.0, 0.0), (0.0, 0.0)
        blank = np.zeros((1, HEIGHT, WIDTH, 3), np.uint8)
        assert (losses_of(gop, blank, behind) > 0).tolist() == [False, True]
