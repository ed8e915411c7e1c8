"""What stands still: found in a video, fitted once, and shown by its GOPs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import gsvrcodec
from gsvrcodec.bitstream.background_payload import unpack_background
from gsvrcodec.encoder.analysis import analyse
from gsvrcodec.encoder.background import (
    StillShot,
    at_rest,
    shown_of,
    still_picture,
    still_png,
    still_rgb,
    still_shots,
)
from gsvrcodec.encoder.jobs import background_task, encode_gop
from gsvrcodec.encoder.plan import Budget
from gsvrcodec.encoder.settings import EncodeSettings
from gsvrcodec.encoder.slicing import slice_gops
from gsvrcodec.fit.field import Field, squared_error
from gsvrcodec.fit.flow import flow_estimator
from gsvrcodec.limits import Limits
from gsvrcodec.model.background import Background, together, with_background
from gsvrcodec.report.inspect import inspect, inspect_bytes, verify
from gsvrcodec.video import open_video
from tests import making
from tests.fit.synthetic import quality, task, unpacked
from tests.gops import make_gop

Frames = NDArray[np.uint8]
SIZE = WIDTH, HEIGHT = 160, 96


def texture(seed: int) -> Frames:
    """A picture with much detail, (H, W, 3)."""
    rng = np.random.default_rng(seed)
    coarse = rng.integers(30, 226, (HEIGHT // 6, WIDTH // 8, 3), np.uint8)
    return coarse.repeat(6, axis=0).repeat(8, axis=1)


def locked_camera(frames: int, *, seed: int = 1) -> Frames:
    """A ball that crosses a background full of detail, (F, H, W, 3)."""
    film = np.repeat(texture(seed)[None], frames, axis=0)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    for number, frame in enumerate(film):
        frame[np.hypot(x - 20 - 5 * number, y - 48) < 14] = (250, 240, 30)
    return film


def shots_of(path: Path, gop: int) -> list[StillShot]:
    with open_video(path) as video:
        steps = list(analyse((frame.rgb for frame in video), flow_estimator("dis")))
        gops = slice_gops(steps, gop, minimum=1, maximum=99)
        return list(still_shots((frame.rgb for frame in video), gops, steps))


@pytest.fixture(scope="module")
def locked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("locked") / "locked.mkv"
    return making.write_video(path, list(locked_camera(24)))


class TestStillPicture:
    def test_a_passing_ball_is_not_in_it(self) -> None:
        picture, share = still_picture(list(locked_camera(24)[::3]))
        assert share > 0.7
        away = np.abs(picture.astype(int) - texture(1)).max(axis=2) > 8
        assert away.mean() < 0.3

    def test_a_pan_has_none(self) -> None:
        wide = np.concatenate([texture(seed) for seed in range(4)], axis=1)
        pan = [wide[:, 17 * n : 17 * n + WIDTH] for n in range(8)]
        assert still_picture(pan)[1] < 0.2

    def test_a_flat_picture_has_no_detail_to_share(self) -> None:
        assert still_picture([np.full((20, 30, 3), 90, np.uint8)] * 3)[1] == 0

    def test_where_a_frame_is_otherwise(self) -> None:
        film = locked_camera(1)
        rests = at_rest(texture(1), film)
        assert not rests[48, 20]
        assert rests[:, 60:].all()


class TestShots:
    def test_a_locked_camera(self, locked: Path) -> None:
        (shot,) = shots_of(locked, 6)
        assert shot.number == 1
        assert shot.gops == range(4)
        assert still_rgb(shot.picture).shape == (HEIGHT, WIDTH, 3)

    def test_one_gop_shares_with_nobody(self, locked: Path) -> None:
        assert shots_of(locked, 24) == []

    def test_a_cut_ends_it(self, tmp_path: Path) -> None:
        film = [*locked_camera(12), *(255 - locked_camera(12, seed=5))]
        path = making.write_video(tmp_path / "cut.mkv", film)
        assert [shot.gops for shot in shots_of(path, 6)] == [range(2), range(2, 4)]

    def test_a_film_that_moves(self) -> None:
        assert shots_of(making.BUNNY_SMALL, 6) == []


@pytest.fixture(scope="module")
def background() -> Background:
    task = background_task(4, texture(1), 24, Budget(900), EncodeSettings(preset="fast", threads=1))
    done = encode_gop(task)
    assert done.psnr > 25
    result = unpack_background(done.payload, Limits())
    assert result.number == 4
    assert len(result.gop) == 900
    return result


class TestFit:
    def test_a_gop_in_front(self, background: Background) -> None:
        film = locked_camera(5)
        job = replace(task(film, 60, preset="fast", threads=1), grid=(8, 5, 3))
        alone = encode_gop(job)
        done = encode_gop(
            replace(job, background=background, background_picture=still_png(texture(1)))
        )
        assert done.psnr > alone.psnr + 3
        content = unpacked(done, job)
        assert content.background == 4
        assert content.shown is not None
        shown = shown_of(background, texture(1), film)
        np.testing.assert_array_equal(content.shown, shown)
        assert 0.5 < shown.mean() < 1
        whole = replace(content, gop=with_background(content.gop, background, content.shown))
        assert quality(whole, film) == pytest.approx(done.psnr, abs=0.02)

    def test_a_gop_without_any_of_it(self, background: Background) -> None:
        job = task(np.zeros((2, HEIGHT, WIDTH, 3), np.uint8), 40, threads=1)
        done = encode_gop(
            replace(job, background=background, background_picture=still_png(texture(1)))
        )
        assert done.payload == encode_gop(job).payload
        assert unpacked(done, job).background == 0

    @pytest.mark.parametrize("size", [SIZE, (80, 48)])
    def test_a_backdrop_is_what_is_drawn_behind(self, size: tuple[int, int]) -> None:
        """The error in front of a backdrop is that of all Gaussians together."""
        own, still = make_gop(8, (3, 2, 2)), make_gop(20, seed=4)
        still = replace(
            still,
            indicator=np.ones_like(still.indicator),
            linear=np.zeros_like(still.linear),
            quadratic=np.zeros_like(still.quadratic),
        )
        target = np.random.default_rng(1).integers(0, 256, (size[1], size[0], 3), np.uint8)
        field = Field(own, "hybrid", still=still)
        backdrop = field.backdrop(size, SIZE, 1)
        loss = squared_error(field.tensors(), 0.3, target, SIZE, 1, backdrop).detach()
        whole = Field(together(own, still), "hybrid")
        expected = squared_error(whole.tensors(), 0.3, target, SIZE, 1).detach()
        assert float(loss) == pytest.approx(float(expected), rel=1e-3)
        assert len(field.gop()) == 8
        assert len(field.drawn()) == 28


class TestEncode:
    def test_a_locked_camera_is_stored_once(self, locked: Path, tmp_path: Path) -> None:
        results = {}
        for backgrounds in (True, False):
            path = tmp_path / f"{backgrounds}.gsvr"
            results[backgrounds] = gsvrcodec.encode(
                locked,
                path,
                gop=6,
                bpp=0.6,
                preset="fast",
                backgrounds=backgrounds,
                workers=1,
                verify=True,
            )
            assert list(verify(path)) == []
        with_backgrounds, without = results[True], results[False]
        assert (with_backgrounds.backgrounds, without.backgrounds) == (1, 0)
        assert with_backgrounds.psnr > without.psnr + 1
        assert 0.57 < with_backgrounds.bpp <= 0.6
        info = inspect(tmp_path / "True.gsvr")
        (background,) = info.backgrounds
        assert [gop.background for gop in info.gops] == [1, 1, 1, 1]
        assert info.metadata.gaussians == with_backgrounds.gaussians
        assert info.parameters > 8 * background.gaussians
        items = {item.name: item.bytes for item in inspect_bytes(tmp_path / "True.gsvr")}
        assert items["shown"] > 0
        assert sum(items.values()) == info.metadata.size_bytes

    def test_any_frame_by_itself(self, locked: Path, tmp_path: Path) -> None:
        path = tmp_path / "a.gsvr"
        gsvrcodec.encode(locked, path, gop=6, params=20_000, preset="fastest", workers=1)
        with gsvrcodec.open(path) as decoder:
            frames = [frame.data for frame in decoder.frames(0, 24)]
            again = [decoder[number].data for number in (23, 0, 13)]
        for frame, number in zip(again, (23, 0, 13), strict=True):
            np.testing.assert_array_equal(frame, frames[number])

    def test_a_quality_is_met(self, locked: Path, tmp_path: Path) -> None:
        result = gsvrcodec.encode(locked, tmp_path / "a.gsvr", gop=12, target_psnr=30, workers=1)
        assert result.backgrounds == 1
        assert abs(result.psnr - 30) < 0.15

    def test_workers_and_resuming_give_the_same_file(self, locked: Path, tmp_path: Path) -> None:
        settings: dict[str, Any] = {"gop": 6, "bpp": 0.5, "preset": "fastest"}
        one, other = tmp_path / "one.gsvr", tmp_path / "other.gsvr"
        gsvrcodec.encode(locked, one, workers=1, **settings)

        def stop(state: object) -> None:
            if getattr(state, "gop", 0) == 2:
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            gsvrcodec.encode(locked, other, workers=1, progress=stop, **settings)
        gsvrcodec.encode(locked, other, workers=2, resume=True, **settings)
        assert one.read_bytes() == other.read_bytes()
