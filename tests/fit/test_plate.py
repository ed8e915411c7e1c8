"""Plates: what they show, for how long, when one pays, how well it is coded."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from gsvrcodec.fit.plate import (
    Run,
    Still,
    differs,
    drift,
    mendable,
    most_usual,
    pays,
    quality_at,
    shows,
    stays,
    still_in,
)
from gsvrcodec.limits import Limits
from gsvrcodec.model.plate import Plate
from gsvrcodec.planes import avif

Frames = NDArray[np.uint8]


def texture(seed: int = 0, width: int = 160, height: int = 96) -> NDArray[np.uint8]:
    """A picture full of detail, without pixels near black or white."""
    noise = np.random.default_rng(seed).normal(128, 60, (height, width, 3))
    return np.asarray(np.clip(cv2.GaussianBlur(noise, (0, 0), 1), 20, 235), np.uint8)


def film(count: int = 12, box: int = 24, noise: float = 0.0) -> Frames:
    """A grey box that goes over a texture from left to right."""
    frames = np.stack([texture()] * count)
    for n, frame in enumerate(frames):
        x = n * (160 - box) // (count - 1)
        frame[30 : 30 + box, x : x + box] = 128
    grain = np.random.default_rng(1).normal(0, noise, frames.shape)
    return np.asarray(np.clip(frames + grain, 0, 255).round(), np.uint8)


def test_what_most_pictures_show() -> None:
    """The ground, though three passers-by hide it in two thirds of the pictures."""
    frames = np.stack([texture()] * 9)
    for n in range(6):
        frames[n, 30:60] = texture(n // 2 + 1)[30:60]
    usual, seen = most_usual(frames)
    for rows, count in (np.s_[:24], 9), (np.s_[36:54], 3), (np.s_[66:], 9):
        assert np.array_equal(usual[rows], texture()[rows])
        assert (seen[rows] == count).all()


def test_a_texture_rather_than_what_is_smooth_before_it() -> None:
    """Though the smooth thing is there longer, and in small places the texture is smooth, too."""
    ground = np.full_like(texture(), 20)
    ground[::12], ground[:, ::12] = 220, 220
    frames = np.stack([ground] * 9)
    frames[:5, 20:80, 30:130] = 170
    usual, seen = most_usual(frames)
    inside = np.s_[30:70, 40:120]
    assert np.array_equal(usual[inside], ground[inside])
    assert (seen[inside] == 4).all()


def test_no_edges_that_no_picture_has() -> None:
    """Where some show one thing and others another, the plate has large parts of each."""
    others = np.stack([texture(n) for n in range(3)])
    usual, _ = most_usual(np.repeat(others, 2, axis=0))
    whose = (usual == others).all(axis=3).argmax(axis=0)
    edges = (np.diff(whose, axis=0) != 0).mean() + (np.diff(whose, axis=1) != 0).mean()
    assert edges < 0.2  # with a choice for each place on its own it is 0.36


@pytest.mark.parametrize("count", [1, 2, 9])
def test_noise_of_what_they_show(count: int) -> None:
    noisy = np.random.default_rng(1).normal(0, 4, (count, *texture().shape)) + texture()
    usual, seen = most_usual(np.clip(noisy, 0, 255).round().astype(np.uint8))
    assert (seen == count).mean() > 0.99
    error = np.square(usual.astype(float) - texture()).mean()
    assert error == pytest.approx(16 / count, rel=0.1, abs=0.2)


def test_what_passes_is_not_in_it() -> None:
    still = still_in(film())
    assert still.share > 0.75
    assert np.abs(still.picture.astype(int) - texture()).mean() < 1
    assert np.abs(still.picture.astype(int) - texture()).max() < 40  # where the box was long


def test_noise_goes() -> None:
    still = still_in(film(noise=4))
    error = np.square(still.picture.astype(float) - texture()).mean()
    assert error < np.square(film(noise=4)[0].astype(float) - texture()).mean() / 4


def test_a_moving_camera_has_none() -> None:
    wide = texture(width=300)
    assert still_in(np.stack([wide[:, 3 * n : 3 * n + 160] for n in range(12)])).share < 0.1


def panned(by: float, count: int = 9) -> Frames:
    """A smooth picture behind a grey box, before a camera that moves right by some px in all."""
    ground = cv2.GaussianBlur(texture(width=200).astype(np.float32), (0, 0), 4)
    ground = (ground - ground.mean()) * 4 + 128
    frames = film(count)
    for n, frame in enumerate(frames):
        map_to = np.array([[1, 0, -20 - by * n / (count - 1)], [0, 1, 0]], np.float32)
        moved = cv2.warpAffine(ground, map_to, (160, 96))
        box = (frame == 128).all(axis=2)[..., None]
        frame[:] = np.where(box, 128, np.clip(moved, 0, 255).round())
    return frames


@pytest.mark.parametrize("by", [0.0, 0.4, 1.5, -1.5])
def test_a_camera_that_moves_slowly(by: float) -> None:
    frames = panned(by)
    still = still_in(frames)
    assert still.share > 0.75  # so it seems
    assert drift(still, frames[0], frames[-1]) == pytest.approx(abs(by), abs=0.15)


def test_what_moves_before_a_locked_camera_is_no_drift() -> None:
    frames = film()
    assert drift(still_in(frames), frames[0], frames[-1]) < 0.05


@pytest.mark.parametrize("first", [film()[0], np.full_like(film()[0], 128)])
def test_where_nothing_is_to_be_seen_nothing_drifts(first: NDArray[np.uint8]) -> None:
    flat = np.full_like(first, 128)
    for where in False, True:
        still = Still(flat, np.full(flat.shape[:2], where), 1.0)
        assert drift(still, first, flat) == 0


def test_where() -> None:
    assert not differs(film()[0], texture())[60:].any()
    assert differs(film()[0], texture())[40, 10]


def test_what_gaussians_can_mend() -> None:
    part = mendable(np.full(texture().shape[:2], 0.25, np.float32), film()[0], texture())
    assert part[40, 10] == 1
    assert (part[60:] == 0.25).all()


def curtain(share: float, count: int = 9) -> Frames:
    """A texture, in front of which others hang down; so much of it is never covered."""
    frames = np.stack([texture()] * count)
    top = round((1 - share) * texture().shape[0])
    for n in range(count):
        frames[n, :top] = texture(n + 1)[:top]
    return frames


@pytest.mark.parametrize(
    ("pictures", "least", "most"),
    [
        (curtain(0.7), 0.0, 0.1),
        (film(9, box=1), 0.9, 1.0),
        (np.repeat(film()[3:4], 9, axis=0), 1.0, 1.0),
        (np.repeat(curtain(0.7, 5), 2, axis=0), 0.5, 0.65),
        (film()[:1], 1.0, 1.0),
    ],
)
def test_what_is_before_a_plate_stays_or_not(pictures: Frames, least: float, most: float) -> None:
    """Others each time, next to nothing, a box that rests, the same for two frames, one frame."""
    assert least <= stays(pictures, texture()) <= most


@pytest.mark.parametrize("share", [0.9, 0.68, 0.3])
def test_the_share_that_stands_still(share: float) -> None:
    still = still_in(curtain(share))
    assert still.share == pytest.approx(share, abs=0.06)
    top = round((1 - share) * 96)
    assert still.where[top + 4 :].all()
    assert not still.where[: top - 4].any()
    assert np.abs(still.picture[top:].astype(int) - texture()[top:]).mean() < 1


def test_frames_that_show_a_plate() -> None:
    """They may show less of it than it took to make it."""
    assert shows(film(), texture())
    assert shows(curtain(0.4, 12), texture())
    assert not shows(curtain(0.1, 12), texture())
    assert not shows(film(), texture(7))


def test_frames_show_a_plate_of_few_bits() -> None:
    """It differs from all of them by the texture that it has lost, but from others by more."""
    coded = avif.encode(texture(), quality_at(400.0))
    plate = Plate(avif.decode(coded, None)).shown()
    assert differs(texture(), plate).mean() > 0.9
    assert shows(film(), plate)
    assert not shows(np.roll(film(), 8, axis=2), plate)
    assert not shows(film(), texture(7))


class TestRun:
    """What stands still in several chains."""

    @staticmethod
    def seen(picture: NDArray[np.uint8], where: NDArray[np.bool_] | bool = True) -> Still:
        return Still(picture, np.broadcast_to(where, picture.shape[:2]), 1.0)

    def test_it_is_their_mean_by_frames(self) -> None:
        """And what it loses is the error of that mean in all frames."""
        run = Run.of(self.seen(texture()), 30)
        assert np.array_equal(run.picture(), texture())
        brighter = texture() + np.uint8(4)
        lost, both = run.with_next(self.seen(brighter), 90, np.inf)
        assert np.array_equal(both.picture(), texture() + 3)
        pixels = texture()[..., 0].size
        assert lost == pytest.approx((30 * 3**2 + 90 * 1**2) * pixels, rel=1e-4)
        more, _ = both.with_next(self.seen(texture() + np.uint8(3)), 50, np.inf)
        assert more == pytest.approx(0, abs=1e-3 * lost)

    def test_what_does_not_stand_still_counts_for_nothing(self) -> None:
        where = np.arange(160) < 80
        run = Run.of(self.seen(texture(), where), 30)
        lost, both = run.with_next(self.seen(texture(5), ~where), 30, np.inf)
        assert lost == 0
        wanted = np.where(where[:, None], texture(), texture(5))
        assert np.array_equal(both.picture(), wanted)

    def test_where_another_thing_stands_it_stays(self) -> None:
        """That is left to Gaussians, and counts for no more than they take."""
        other = texture()
        other[20:60, 40:90] = texture(5)[20:60, 40:90]
        run = Run.of(self.seen(texture()), 30)
        lost, both = run.with_next(self.seen(other), 30, 100.0)
        assert (both.picture() != texture()).any(axis=2).sum() < 20  # at the corners
        assert 0.9 * 100 * 40 * 50 < lost <= 100 * 40 * 50


def test_quality() -> None:
    """The less a bit has to save in each frame, the better."""
    found = [quality_at(worth) for worth in (0.1, 1, 4, 16, 64, 256, 1e6)]
    assert found == sorted(found, reverse=True)
    assert 0 <= found[-1] < found[0] <= 100


def test_a_bit_of_a_plate_saves_what_it_has_to() -> None:
    """Of the plate, between two qualities about that which is chosen."""
    picture = np.asarray(cv2.resize(texture(), (640, 384), interpolation=cv2.INTER_CUBIC), np.uint8)
    for worth in (1.0, 4.0, 16.0):
        sizes, errors = [], []
        for step in (-3, 3):
            coded = avif.encode(picture, quality_at(worth) + step)
            shown = Plate(avif.decode(coded, None)).shown()
            sizes.append(len(coded))
            errors.append(np.square(shown.astype(float) - picture).mean() * picture[..., 0].size)
        saved = (errors[0] - errors[1]) / (8 * (sizes[1] - sizes[0]))
        assert worth / 1.6 < saved < worth * 1.6


def test_smooth_pictures_are_left_to_gaussians() -> None:
    """But for those that stand still all the time and show something."""
    picture, where = np.zeros((250, 400, 3), np.uint8), np.ones((250, 400), np.bool_)
    most, much = Still(picture, where, 0.8), Still(picture, where, 0.7)
    assert not pays(most, 100, lasts=True)
    assert pays(most, 1_000, lasts=True)
    assert not pays(much, 1_000, lasts=True)
    assert not pays(most, 1_000, lasts=False)
    assert pays(much, 25_000, lasts=True)
    assert pays(most, 25_000, lasts=False)


def test_black_is_no_plate_that_expands_to_more_than_a_decoder_allows() -> None:
    for width, height in (7680, 4320), (16384, 16384):
        size = height, width
        black, where = np.broadcast_to(np.uint8(0), (*size, 3)), np.broadcast_to(np.True_, size)
        still = Still(black, where, 1.0)
        least = next(n for n in range(1, 2**31, 1000) if pays(still, n, lasts=True))
        Limits().check_expansion(3 * width * height, least)
