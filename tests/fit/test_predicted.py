"""Predicted fits: what stays is kept, what moves is followed, what is new gets new Gaussians."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from gsvrcodec.fit.fitting import Allowance, Fit, fit_gop, mean_psnr
from gsvrcodec.fit.footage import Footage, Frames
from gsvrcodec.fit.parameters import LOOK, Anchor
from gsvrcodec.fit.predicted import LastFrame, change_worth, fit_predicted
from gsvrcodec.fit.quantise import quantisable
from gsvrcodec.fit.recipe import Deform, FitOptions
from gsvrcodec.fit.start import affordable
from gsvrcodec.fit.target import Slope
from gsvrcodec.fit.tuned import EFFORT, PREDICTION, STAGED
from gsvrcodec.metrics import psnr
from gsvrcodec.model.gop import Float32Array, Gop, grid_size
from gsvrcodec.model.prediction import last_look, look_at
from gsvrcodec.model.static import append_gaussians, static_gop
from tests.fit.synthetic import BACKEND, assert_finite, footage, moving_texture

SIZE = WIDTH, HEIGHT = 96, 64
GAUSSIANS = 500
GRID = (6, 4, 4)
FRAMES = 4
#: Where the square is in the key GOP: first column, first row, side.
SQUARE = (10, 20, 16)


def film(step: float = 0.0, *, news: bool = False) -> Frames:
    """A patterned square over a texture moves on by `step` pixels a frame; a blue one may come."""
    shots = moving_texture(1, (0, 0), SIZE).repeat(FRAMES, axis=0)
    left, top, side = SQUARE
    pattern = np.random.default_rng(8).integers(0, 2, (4, 4, 3), np.uint8)
    pattern = 30 + 200 * pattern.repeat(4, axis=0).repeat(4, axis=1)
    for number, shot in enumerate(shots, 1):
        x = round(left + step * number)
        shot[top : top + side, x : x + side] = pattern
        if news:
            shot[44:56, 70:82] = (20, 40, 250)
    return shots


@dataclass(frozen=True)
class Key:
    """A key GOP of the film that stands still."""

    fit: Fit
    reference: LastFrame


@pytest.fixture(scope="module")
def key() -> Key:
    options, effort = FitOptions(), Allowance(400, None)
    fit = fit_gop(footage(film()), GAUSSIANS, GRID, options, effort, BACKEND, seed=(0, 0))
    end = np.array([1], np.float32)
    shown = BACKEND.render(BACKEND.prepare(fit.gop), end, SIZE, SIZE)[0]
    return Key(fit, LastFrame(last_look(fit.gop, FRAMES), shown, film()[-1], 1.0, fit.psnr))


def static(reference: LastFrame) -> Gop:
    """The reference as it would be kept."""
    return static_gop(*(getattr(reference.look, name) for name in LOOK))


def predicted(
    key: Key,
    frames: Frames,
    options: FitOptions | None = None,
    *,
    gaussians: int = GAUSSIANS,
    allowance: Allowance | None = None,
    seed: int = 0,
    slope: Slope | None = None,
) -> Fit:
    chosen = options or FitOptions()
    fit = fit_predicted(
        footage(frames),
        key.reference,
        gaussians,
        (0, 0, 0) if chosen.deform == "polynomial" else GRID,
        chosen,
        allowance or Allowance(150, None),
        BACKEND,
        seed=(seed, 4),
        slope=slope,
    )
    assert fit is not None
    return fit


def parts(fit: Fit) -> tuple[np.ndarray, Anchor]:
    """Return which Gaussians of the reference are kept, and the anchor of the others."""
    assert fit.kept is not None
    assert fit.anchor is not None
    return fit.kept, fit.anchor


def inside(position: Float32Array, left: float, top: float, side: float) -> np.ndarray:
    """Whether centres lie in a square of the picture, in pixels."""
    x, y = ((position + 1) / 2 * SIZE).T
    return np.asarray((left <= x) & (x < left + side) & (top <= y) & (y < top + side))


def test_more_are_kept_where_changes_have_to_be_worth_more(key: Key) -> None:
    usual = key.reference.qscale
    kept = []
    for qscale in (0.1 * usual, usual, 100 * usual):
        coarse = replace(key, reference=replace(key.reference, qscale=qscale))
        kept.append(int(parts(predicted(coarse, film(news=True)))[0].sum()))
    assert kept[0] < kept[1] < kept[2]


class TestChangeWorth:
    def worth(self, gop: Gop, frames: Frames) -> np.ndarray:
        return np.asarray(change_worth(gop, footage(frames), np.random.default_rng(0), BACKEND))

    def test_a_still_film_is_worth_next_to_nothing(self, key: Key) -> None:
        gop = static(key.reference)
        still, inverse = self.worth(gop, film()), self.worth(gop, 255 - film())
        assert still.shape == (GAUSSIANS,)
        assert np.median(still) * 1000 < np.median(inverse)

    def test_much_where_the_picture_changes(self, key: Key) -> None:
        gop = static(key.reference)
        worth = self.worth(gop, film(news=True))
        there = inside(gop.position, 70, 44, 12)
        far = ~inside(gop.position, 58, 32, 36)
        assert there.any()
        assert np.median(worth[there]) > 50 * np.median(worth[far])

    def test_it_foresees_the_error_of_a_change_of_colour(self) -> None:
        """Of Gaussians far from each other, the worth is the squared error that a change undoes."""
        x, y = np.meshgrid([-0.6, 0, 0.6], [-0.5, 0.5])
        count = 6
        gop = static_gop(
            np.stack([x.ravel(), y.ravel()], 1).astype(np.float32),
            np.full((count, 2), 1.2, np.float32),
            np.zeros(count, np.float32),
            np.full((count, 3), 0.5, np.float32),
            np.zeros(count, np.float32),
        )
        changed = replace(gop, colour=gop.colour.copy())
        changed.colour[2] = (0.8, 0.3, 0.6)
        frames, before = (
            BACKEND.render(BACKEND.prepare(one), np.zeros(5, np.float32), SIZE, SIZE)
            for one in (changed, gop)
        )
        error = np.square(frames.astype(float) - before).sum() / 3
        shots = footage(frames.astype(np.uint8))
        # Sensitivities are drawn: one draw alone may be twice as large as another.
        worth = np.array(
            [change_worth(gop, shots, np.random.default_rng(n), BACKEND) for n in range(41)]
        )
        assert np.median(worth[:, 2]) == pytest.approx(error, rel=0.5)
        assert np.delete(worth, 2, axis=1).max() < 0.02 * error

    def test_motion_is_worth_more_than_one_change_can_do(self, key: Key) -> None:
        """A square that goes back and forth does not change in the mean."""
        gop = static(key.reference)
        shots = np.stack([film(-2)[0], film(2)[0]] * 3)
        assert np.abs(shots.mean(axis=0) - film()[0]).mean() < 10
        worth = self.worth(gop, shots)
        edges = inside(gop.position, *SQUARE)
        assert np.median(worth[edges]) > 20 * np.median(worth[~edges])


class TestKept:
    def test_more_where_the_source_is_as_before(self, key: Key) -> None:
        """The same error of the same picture, which the source has had before, or not."""
        brighter = film() // 8 * 7 + 16
        before = replace(key, reference=replace(key.reference, source=brighter[0]))
        new, old = (parts(predicted(one, brighter))[0].sum() for one in (key, before))
        assert old > new + 0.2 * GAUSSIANS

    def test_nearly_everything_of_a_still_film(self, key: Key) -> None:
        fit = predicted(key, film())
        kept, anchor = parts(fit)
        assert kept.sum() > 0.95 * GAUSSIANS
        assert fit.psnr > key.fit.psnr - 0.3
        assert not (kept[anchor.source[anchor.carried]]).any()

    def test_every_gaussian_has_one_fate(self, key: Key) -> None:
        fit = predicted(key, film(2))
        kept, anchor = parts(fit)
        sources = anchor.source[anchor.carried]
        assert len(set(sources)) == len(sources)
        assert not kept[sources].any()
        assert len(fit.gop) == len(anchor.source)
        assert kept.sum() + len(fit.gop) == GAUSSIANS
        # Some are replaced by new ones.
        assert (~anchor.carried).sum() >= int(PREDICTION.renewed_first * len(fit.gop)) > 0

    def test_more_is_kept_at_a_high_qscale(self, key: Key) -> None:
        counts = []
        for qscale in (0.3, 3.0):
            other = replace(key, reference=replace(key.reference, qscale=qscale))
            counts.append(int(parts(predicted(other, film(2)))[0].sum()))
        assert counts[0] < counts[1]

    def test_what_is_kept_is_drawn_behind(self, key: Key) -> None:
        fit = predicted(key, film(2))
        kept, _ = parts(fit)
        behind = fit.footage.background
        assert behind is not None
        for name in LOOK:
            expected = getattr(key.reference.look, name)[kept]
            np.testing.assert_array_equal(getattr(behind, name), expected)
        assert fit.psnr == mean_psnr(fit.drawn(fit.gop), fit.footage, BACKEND)


class TestFollowed:
    def test_a_moving_square(self, key: Key) -> None:
        frames = film(2)
        fit = predicted(key, frames)
        kept, anchor = parts(fit)
        far = ~inside(key.reference.look.position, 4, 14, 44)
        assert kept[far].mean() > 0.95
        stays = np.mean([psnr(key.reference.picture, shot) for shot in frames])
        assert fit.psnr > stays + 8
        # The Gaussians of the square go with it: 2 px a frame, 8 px to the last one.
        left, top, side = SQUARE
        within = inside(anchor.look.position, left + 1, top + 1, side - 2) & anchor.carried
        assert within.sum() >= 8
        way = look_at(fit.drawn(fit.gop), 1.0).position - anchor.look.position
        x, y = np.median(way[within], axis=0) * (WIDTH / 2, HEIGHT / 2)
        assert 3 < x < 10
        assert abs(y) < 2

    def test_a_new_object_gets_new_gaussians(self, key: Key) -> None:
        frames = film(news=True)
        # Twenty more than before, which have to go somewhere.
        fit = predicted(key, frames, gaussians=GAUSSIANS + 20)
        _, anchor = parts(fit)
        new = ~anchor.carried
        assert new.sum() >= 20
        drawn = fit.drawn(fit.gop)
        assert inside(drawn.position[new], 66, 40, 20).mean() > 0.6
        assert np.abs(drawn.colour[new]).max() > 0.1
        stays = np.mean([psnr(key.reference.picture, shot) for shot in frames])
        assert fit.psnr > stays + 8


def test_what_cannot_be_predicted_is_not(key: Key) -> None:
    found = fit_predicted(
        footage(255 - film()),
        key.reference,
        GAUSSIANS,
        GRID,
        FitOptions(),
        Allowance(10, None),
        BACKEND,
        seed=(0, 4),
    )
    assert found is None


def test_what_is_mostly_still_is_predicted_whatever_the_rest_does(key: Key) -> None:
    frames = film()
    frames[:, :, 60:] = 255 - frames[:, :, 60:]
    stays = np.mean([psnr(key.reference.picture, shot) for shot in frames])
    assert stays < PREDICTION.lost
    fit = predicted(key, frames)
    kept, _ = parts(fit)
    assert kept.mean() > PREDICTION.still
    assert fit.psnr > stays + 6


class TestNumbers:
    @pytest.mark.parametrize("gaussians", [440, 480, 700])
    def test_as_many_as_asked_for(self, key: Key, gaussians: int) -> None:
        fit = predicted(key, film() // 8 * 7, gaussians=gaussians)
        kept, anchor = parts(fit)
        assert len(fit.gop) + kept.sum() == max(gaussians, kept.sum() + 1)
        if gaussians > GAUSSIANS:
            assert (~anchor.carried).sum() >= gaussians - GAUSSIANS
        assert_finite(fit.gop)

    def test_they_follow_a_slope(self, key: Key) -> None:
        counts, frames = [], film(3, news=True)
        without = len(predicted(key, frames).gop)
        for qscale in (0.2, 5.0):
            fit = predicted(key, frames, slope=Slope(qscale, 3000))
            kept, anchor = parts(fit)
            carried = anchor.source[anchor.carried]
            assert len(set(carried.tolist())) == len(carried)
            assert not kept[carried].any()
            assert_finite(fit.drawn(fit.gop))
            counts.append(len(fit.gop))
        assert counts[0] > without > counts[1]

    def test_what_comes_in_gets_as_many_as_it_needs(self, key: Key) -> None:
        """From the beginning: more than twice the few that change around it."""
        frames, box = film(), np.s_[32:56, 64:88]
        pattern = np.random.default_rng(3).integers(0, 2, (6, 6, 3), np.uint8)
        frames[:, *box] = 30 + 200 * pattern.repeat(4, axis=0).repeat(4, axis=1)
        fit = predicted(key, frames, slope=Slope(0.4, 3000))
        kept, anchor = parts(fit)
        assert kept.mean() > PREDICTION.kept
        assert (~anchor.carried).sum() > 200
        assert fit.footage.background is not None
        gop = append_gaussians(fit.drawn(fit.gop), fit.footage.background)
        shown = BACKEND.render(BACKEND.prepare(gop), np.zeros(1, np.float32), SIZE, SIZE)[0]
        assert psnr(shown[box], frames[0][box]) > 40

    def test_the_weakest_are_dropped_and_leave_no_hole(self, key: Key) -> None:
        fit = predicted(key, film(2), gaussians=480)
        stays = np.mean([psnr(key.reference.picture, shot) for shot in film(2)])
        assert fit.psnr > stays + 2
        kept, anchor = parts(fit)
        look = key.reference.look
        area = np.exp(look.log_scale.sum(axis=1))
        there = kept.copy()
        there[anchor.source[anchor.carried]] = True
        assert area[~there].mean() < 0.5 * area[there].mean()


class TestFit:
    def test_same_seed_same_fit(self, key: Key) -> None:
        one, again, other = (predicted(key, film(2), seed=seed) for seed in (1, 1, 2))
        for name in Gop.__slots__:
            np.testing.assert_array_equal(getattr(one.gop, name), getattr(again.gop, name))
        np.testing.assert_array_equal(parts(one)[0], parts(again)[0])
        np.testing.assert_array_equal(parts(one)[1].source, parts(again)[1].source)
        assert not np.array_equal(one.gop.position, other.gop.position)

    @pytest.mark.parametrize("deform", ["polynomial", "triplane"])
    def test_every_deformation(self, key: Key, deform: Deform) -> None:
        frames = film(1)
        fit = predicted(key, frames, FitOptions(deform=deform))
        assert_finite(fit.gop)
        assert fit.gop.linear.any() == (deform == "polynomial")
        assert grid_size(fit.gop) == affordable(
            (0, 0, 0) if deform == "polynomial" else GRID, len(fit.gop), "mean"
        )
        stays = np.mean([psnr(key.reference.picture, shot) for shot in frames])
        assert fit.psnr > stays + 2

    @pytest.mark.parametrize("frames", [1, 2])
    def test_few_frames(self, key: Key, frames: int) -> None:
        fit = predicted(key, film(2)[:frames])
        _, anchor = parts(fit)
        assert anchor.start == (-1 if frames == 1 else -3)
        assert_finite(fit.drawn(fit.gop))
        assert fit.psnr > 25

    def test_a_share_is_left_for_tuning(self, key: Key) -> None:
        fit = predicted(key, film(2), allowance=Allowance(400, None))
        assert fit.steps == round((1 - STAGED.effort) * 400)
        assert fit.tuning == Allowance(round(STAGED.effort * 400), None)
        assert predicted(key, film(2), FitOptions(tune=False)).tuning is None

    def test_there_is_a_least(self, key: Key) -> None:
        fit = predicted(key, film(2), allowance=Allowance(1, None))
        assert fit.steps == PREDICTION.least_steps
        assert fit.tuning == Allowance(EFFORT.least_tuning_steps, None)

    def test_fewer_change_if_time_is_short(self, key: Key) -> None:
        """The threshold rises until the time suffices, but not without bound."""
        changing = [
            np.count_nonzero(~parts(predicted(key, film(2), allowance=one))[0])
            for one in (Allowance(60, None), Allowance(60, None, 40), Allowance(60, None, 0.0))
        ]
        assert changing[0] > changing[1] >= changing[2] > 0
        assert changing[1] >= 40

    def test_no_time_left(self, key: Key) -> None:
        fit = predicted(key, film(2), allowance=Allowance(10**9, -5.0))
        assert_finite(fit.gop)
        assert fit.tuning == Allowance(round(STAGED.effort * 10**9), 0.1)

    def test_its_arguments_are_left_alone(self, key: Key) -> None:
        before = {name: getattr(key.reference.look, name).copy() for name in LOOK}
        shots: Footage = footage(film(2))
        fit = predicted(key, shots.frames)
        assert fit.footage.frames is shots.frames
        for name, values in before.items():
            np.testing.assert_array_equal(getattr(key.reference.look, name), values)


def test_what_leaves_the_frame_does_not_come_back(key: Key) -> None:
    """Nothing changes where they are, but at rest they would be in the picture."""
    fit = predicted(key, film(2))
    _, anchor = parts(fit)
    in_sight = np.abs(anchor.look.position).max(axis=1) < 0.8
    leaving = np.flatnonzero(anchor.carried & in_sight)[:5]
    stored = replace(fit.gop, linear=fit.gop.linear.copy(), indicator=fit.gop.indicator.copy())
    stored.linear[leaving] = 400.0, 0.0
    stored.indicator[leaving] = 1.0
    gone = replace(fit, gop=stored, tuning=None)
    found = quantisable(gone, FitOptions(), BACKEND, lambda *_: 1, seed=(0, 0))
    assert found.quantised(4.0).gop.linear[leaving].any(axis=1).all()
