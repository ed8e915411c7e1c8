"""The plate of a key GOP: what it shows, when there is one, how well it is coded."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from gsvrcodec.fit.plate import Still, differs, most_usual, pays, quality_at, still_picture
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


@pytest.mark.parametrize("count", [1, 2, 9])
def test_noise_of_what_they_show(count: int) -> None:
    noisy = np.random.default_rng(1).normal(0, 4, (count, *texture().shape)) + texture()
    usual, seen = most_usual(np.clip(noisy, 0, 255).round().astype(np.uint8))
    assert (seen == count).mean() > 0.99
    error = np.square(usual.astype(float) - texture()).mean()
    assert error == pytest.approx(16 / count, rel=0.1, abs=0.2)


def test_what_passes_is_not_in_it() -> None:
    still = still_picture(film())
    assert still is not None
    assert np.abs(still.picture.astype(int) - texture()).mean() < 1
    assert np.abs(still.picture.astype(int) - texture()).max() < 40  # where the box was long


def test_what_only_the_rest_of_a_chain_uncovers_is_in_it() -> None:
    """A box that stands still in the first GOP, and goes on after it."""
    waiting = np.repeat(film(9)[:1], 8, axis=0)
    alone, found = still_picture(waiting), still_picture(waiting, several=film(9))
    assert alone is not None
    assert found is not None
    box = np.s_[32:52, 2:22]
    assert (alone.picture[box] == 128).all()
    assert np.abs(found.picture.astype(int) - texture()).mean() < 1


def test_noise_goes() -> None:
    still = still_picture(film(noise=4))
    assert still is not None
    error = np.square(still.picture.astype(float) - texture()).mean()
    assert error < np.square(film(noise=4)[0].astype(float) - texture()).mean() / 4


def test_a_moving_camera_has_none() -> None:
    wide = texture(width=300)
    assert still_picture(np.stack([wide[:, 3 * n : 3 * n + 160] for n in range(12)])) is None


def test_few_frames_have_none() -> None:
    """Of one picture nothing lasts: Gaussians draw it."""
    assert still_picture(film()[:1]) is None
    assert still_picture(film()[:5]) is None
    assert still_picture(film()[:6]) is not None


def test_where() -> None:
    assert not differs(film()[0], texture())[60:].any()
    assert differs(film()[0], texture())[40, 10]


def curtain(share: float, count: int = 9) -> Frames:
    """A texture, in front of which others hang down; so much of it is never covered."""
    frames = np.stack([texture()] * count)
    top = round((1 - share) * texture().shape[0])
    for n in range(count):
        frames[n, :top] = texture(n + 1)[:top]
    return frames


@pytest.mark.parametrize(("share", "lasts"), [(0.9, True), (0.68, False)])
def test_what_lasts(share: float, lasts: bool) -> None:
    """Of a whole chain less has to stand still than of a GOP that is a part of it."""
    still = still_picture(film(), several=curtain(share))
    assert still is not None
    assert still.lasts == lasts
    uncovered = still.picture[40:].astype(int)
    assert np.abs(uncovered - texture()[40:]).mean() < 1


def test_what_lasts_for_one_gop() -> None:
    still = still_picture(film(), several=curtain(0.5))
    assert still is not None
    assert not still.lasts
    assert np.abs(still.picture.astype(int) - texture()).mean() < 1
    assert still_picture(curtain(0.68, 12), several=curtain(0.5)) is None


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
    picture = np.zeros((250, 400, 3), np.uint8)
    assert not pays(Still(picture, lasts=True), 100)
    assert pays(Still(picture, lasts=False), 25_000)
    assert not pays(Still(picture, lasts=False), 1_000)
    assert pays(Still(picture, lasts=True), 1_000)


def test_black_is_no_plate_that_expands_to_more_than_a_decoder_allows() -> None:
    for width, height in (7680, 4320), (16384, 16384):
        black = Still(np.broadcast_to(np.uint8(0), (height, width, 3)), lasts=True)
        least = next(n for n in range(1, 2**31, 1000) if pays(black, n))
        Limits().check_expansion(3 * width * height, least)
