"""What is static: found in a video, fitted once, and shown by its GOPs."""

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
    StaticRun,
    shows,
    static_picture,
    static_runs,
    visible_gaussians,
)
from gsvrcodec.encoder.budget import Budget
from gsvrcodec.encoder.encode import EncodeResult
from gsvrcodec.encoder.jobs import BackgroundJob, encode_gop
from gsvrcodec.encoder.settings import EncodeSettings
from gsvrcodec.encoder.slicing import slice_gops
from gsvrcodec.fit.field import Field, squared_error
from gsvrcodec.fit.flow import flow_estimator
from gsvrcodec.limits import Limits
from gsvrcodec.model.background import Background, append_background, append_gaussians
from gsvrcodec.report.inspect import inspect, inspect_bytes, verify
from gsvrcodec.video import open_video
from tests import making
from tests.fit.synthetic import BACKEND, gop_job, quality, unpacked
from tests.gops import make_gop

Frames = NDArray[np.uint8]
SIZE = WIDTH, HEIGHT = 160, 96


def texture(seed: int, cell: int = 1) -> Frames:
    """A picture with much detail, (H, W, 3), of cells `cell` times 8 by 6 pixels large."""
    rng = np.random.default_rng(seed)
    coarse = rng.integers(30, 226, (HEIGHT // 6 // cell, WIDTH // 8 // cell, 3), np.uint8)
    return coarse.repeat(6 * cell, axis=0).repeat(8 * cell, axis=1)


def locked_camera(frames: int, *, seed: int = 1, cell: int = 1) -> Frames:
    """A ball that crosses a background full of detail, (F, H, W, 3)."""
    film = np.repeat(texture(seed, cell)[None], frames, axis=0)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    for number, frame in enumerate(film):
        frame[np.hypot(x - 20 - 5 * number, y - 48) < 14] = (250, 240, 30)
    return film


def runs_of(path: Path, gop: int) -> list[StaticRun]:
    with open_video(path) as video:
        stats = list(analyse((frame.rgb for frame in video), flow_estimator("dis")))
        gops = slice_gops(stats, gop, minimum=1, maximum=99)
        return list(static_runs((frame.rgb for frame in video), gops, stats))


@pytest.fixture(scope="module")
def locked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("locked") / "locked.mkv"
    return making.write_video(path, list(locked_camera(16)))


class TestStaticPicture:
    def test_a_passing_ball_is_not_in_it(self) -> None:
        picture, share = static_picture(list(locked_camera(24)[::3]))
        assert share > 0.7
        away = np.abs(picture.astype(int) - texture(1)).max(axis=2) > 8
        assert away.mean() < 0.3

    def test_a_pan_has_none(self) -> None:
        wide = np.concatenate([texture(seed) for seed in range(4)], axis=1)
        pan = [wide[:, 17 * n : 17 * n + WIDTH] for n in range(8)]
        assert static_picture(pan)[1] < 0.2

    def test_a_flat_picture_has_no_detail_to_share(self) -> None:
        assert static_picture([np.full((20, 30, 3), 90, np.uint8)] * 3)[1] == 0

    def test_where_a_frame_is_otherwise(self) -> None:
        film = locked_camera(1)
        same = shows(texture(1), film)
        assert not same[48, 20]
        assert same[:, 60:].all()


class TestRuns:
    def test_a_locked_camera(self, locked: Path) -> None:
        (run,) = runs_of(locked, 4)
        assert run.number == 1
        assert run.gops == range(4)
        assert run.picture.shape == (HEIGHT, WIDTH, 3)

    def test_one_gop_shares_with_nobody(self, locked: Path) -> None:
        assert runs_of(locked, 16) == []

    def test_a_cut_ends_it(self, tmp_path: Path) -> None:
        film = [*locked_camera(12), *(255 - locked_camera(12, seed=5))]
        path = making.write_video(tmp_path / "cut.mkv", film)
        assert [run.gops for run in runs_of(path, 6)] == [range(2), range(2, 4)]

    def test_a_film_that_moves(self) -> None:
        assert runs_of(making.BUNNY_SMALL, 6) == []


@pytest.fixture(scope="module")
def background() -> Background:
    job = BackgroundJob(
        frames=texture(1)[None],
        budget=Budget(900),
        settings=EncodeSettings(preset="fast", threads=1),
        number=4,
        shown=24,
    )
    done = encode_gop(job)
    assert done.psnr > 25
    result = unpack_background(done.payload, Limits())
    assert result.number == 4
    assert len(result.gop) == 900
    return result


class TestFit:
    def test_a_gop_in_front(self, background: Background) -> None:
        film = locked_camera(5)
        job = gop_job(film, Budget(60, grid=(8, 5, 3)), preset="fast", threads=1)
        alone = encode_gop(job)
        done = encode_gop(replace(job, background=background, background_picture=texture(1)))
        assert done.psnr > alone.psnr + 3
        content = unpacked(done, job)
        assert content.background == 4
        assert content.shown is not None
        shown = visible_gaussians(background, texture(1), film)
        np.testing.assert_array_equal(content.shown, shown)
        assert 0.5 < shown.mean() < 1
        whole = replace(content, gop=append_background(content.gop, background, content.shown))
        assert quality(whole, film) == pytest.approx(done.psnr, abs=0.02)

    def test_a_gop_without_any_of_it(self, background: Background) -> None:
        job = gop_job(np.zeros((2, HEIGHT, WIDTH, 3), np.uint8), 40, threads=1)
        done = encode_gop(replace(job, background=background, background_picture=texture(1)))
        assert done.payload == encode_gop(job).payload
        assert unpacked(done, job).background == 0

    @pytest.mark.parametrize("size", [SIZE, (80, 48)])
    def test_a_backdrop_is_what_is_drawn_behind(self, size: tuple[int, int]) -> None:
        """The error in front of a backdrop is that of all Gaussians together."""
        own, static = make_gop(8, (3, 2, 2)), make_gop(20, seed=4)
        static = replace(
            static,
            indicator=np.ones_like(static.indicator),
            linear=np.zeros_like(static.linear),
            quadratic=np.zeros_like(static.quadratic),
        )
        target = np.random.default_rng(1).integers(0, 256, (size[1], size[0], 3), np.uint8)
        field = Field(own, "hybrid", BACKEND, static)
        backdrop = field.backdrop(size, SIZE)
        loss = squared_error(BACKEND, field.tensors(), 0.3, target, SIZE, backdrop).detach()
        whole = Field(append_gaussians(own, static), "hybrid", BACKEND)
        expected = squared_error(BACKEND, whole.tensors(), 0.3, target, SIZE).detach()
        assert float(loss) == pytest.approx(float(expected), rel=1e-3)
        assert len(field.gop()) == 8
        assert len(field.drawn()) == 28


#: The cheapest way to code planes: how is no matter here.
SETTINGS: dict[str, Any] = {"gop": 4, "bpp": 0.6, "preset": "fastest", "pack": "deflate"}


@pytest.fixture(scope="module")
def stored(locked: Path) -> EncodeResult:
    """The locked camera's film as a file with a background."""
    target = locked.with_name("stored.gsvr")
    return gsvrcodec.encode(locked, target, workers=1, verify=True, **SETTINGS)


class TestEncode:
    def test_a_locked_camera_is_stored_once(
        self, locked: Path, stored: EncodeResult, tmp_path: Path
    ) -> None:
        assert list(verify(stored.path)) == []
        without = gsvrcodec.encode(
            locked, tmp_path / "a.gsvr", backgrounds=False, workers=1, **SETTINGS
        )
        assert (stored.backgrounds, without.backgrounds) == (1, 0)
        assert stored.psnr > without.psnr + 1
        assert 0.57 < stored.bpp <= 0.6
        info = inspect(stored.path)
        (background,) = info.backgrounds
        assert [gop.background for gop in info.gops] == [1, 1, 1, 1]
        assert info.metadata.gaussians == stored.gaussians
        assert info.parameters > 8 * background.gaussians
        items = {item.name: item.bytes for item in inspect_bytes(stored.path)}
        assert items["shown"] > 0
        assert sum(items.values()) == info.metadata.size_bytes

    def test_any_frame_by_itself(self, stored: EncodeResult) -> None:
        with gsvrcodec.open(stored.path) as decoder:
            frames = [frame.data for frame in decoder.frames(0, 16)]
            again = [decoder[number].data for number in (15, 0, 9)]
        for frame, number in zip(again, (15, 0, 9), strict=True):
            np.testing.assert_array_equal(frame, frames[number])

    def test_a_quality_is_met(self, tmp_path: Path) -> None:
        source = making.write_video(tmp_path / "a.mkv", list(locked_camera(8, cell=4)))
        settings: dict[str, Any] = {"target_psnr": 30, "gop": 4, "preset": "fast", "workers": 1}
        result = gsvrcodec.encode(source, tmp_path / "a.gsvr", pack="deflate", **settings)
        assert result.backgrounds == 1
        assert abs(result.psnr - 30) < 0.15

    def test_workers_and_resuming_give_the_same_file(
        self, locked: Path, stored: EncodeResult, tmp_path: Path
    ) -> None:
        def stop(state: object) -> None:
            if getattr(state, "gop", 0) == 2:
                raise KeyboardInterrupt

        target = tmp_path / "a.gsvr"
        with pytest.raises(KeyboardInterrupt):
            gsvrcodec.encode(locked, target, workers=1, progress=stop, **SETTINGS)
        gsvrcodec.encode(locked, target, workers=2, resume=True, **SETTINGS)
        assert target.read_bytes() == stored.path.read_bytes()
