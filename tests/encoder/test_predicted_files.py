"""Whole files of key and predicted GOPs: where chains begin, what they save, what damage costs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import gsvrcodec
from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.encoder.encode import EncodeResult
from gsvrcodec.errors import CorruptError
from gsvrcodec.report.inspect import inspect_bytes, verify
from tests import making
from tests.fit.synthetic import moving_texture

Frames = NDArray[np.uint8]
SIZE = WIDTH, HEIGHT = 128, 80
#: Frames a second of the films here, so that a chain of `keyint=0.32` has eight frames at most.
SETTINGS: dict[str, Any] = {"gop": 4, "keyint": 0.32, "preset": "fastest", "workers": 1}


def locked_camera(frames: int, *, seed: int = 0) -> Frames:
    """A ball that crosses a texture, (F, H, W, 3)."""
    picture = np.roll(moving_texture(1, (0, 0), SIZE)[0], 17 * seed, axis=(0, 1))
    film: Frames = picture[None].repeat(frames, axis=0)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    for number, frame in enumerate(film):
        frame[np.hypot(x - 20 - 3 * number, y - 40) < 10] = (250, 240, 30)
    return film


def place(result: EncodeResult) -> Path:
    """The path of a film that was encoded to a file."""
    assert result.path is not None
    return result.path


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Sixteen frames without a cut."""
    path = tmp_path_factory.mktemp("locked") / "locked.mkv"
    return making.write_video(path, list(locked_camera(16)))


@pytest.fixture(scope="module")
def stored(film: Path) -> EncodeResult:
    """The film as two chains of two GOPs, verified."""
    target = film.with_name("stored.gsvr")
    return gsvrcodec.encode(film, target, gaussians=500, verify=True, **SETTINGS)


class TestChains:
    def test_keyint_bounds_them(self, stored: EncodeResult) -> None:
        assert [gop.key for gop in stored.gop_stats] == [True, False, True, False]
        assert (stored.gops, stored.key_gops) == (4, 2)
        with GsvrReader(place(stored)) as reader:
            assert [reader.chain_of(number) for number in range(4)] == [[0], [0, 1], [2], [2, 3]]
        assert list(verify(place(stored))) == []

    def test_keyint_0_gives_key_gops_alone(self, film: Path, tmp_path: Path) -> None:
        target = tmp_path / "a.gsvr"
        result = gsvrcodec.encode(film, target, **{**SETTINGS, "keyint": 0, "gaussians": 50})
        assert result.key_gops == result.gops == 4
        assert all(gop.key for gop in result.gop_stats)
        with GsvrReader(target) as reader:
            assert [reader.chain_of(number) for number in range(4)] == [[0], [1], [2], [3]]

    def test_a_cut_begins_one(self, tmp_path: Path) -> None:
        pictures = [*locked_camera(6), *(255 - locked_camera(6, seed=1))]
        source = making.write_video(tmp_path / "cut.mkv", pictures)
        settings = {**SETTINGS, "keyint": 99, "gaussians": 50}
        result = gsvrcodec.encode(source, tmp_path / "a.gsvr", **settings)
        assert [(gop.first_frame, gop.cut, gop.key) for gop in result.gop_stats] == [
            *((0, True, True), (4, False, False)),
            *((6, True, True), (10, False, False)),
        ]


class TestWorth:
    def test_what_lasts_is_stored_once(self, stored: EncodeResult) -> None:
        first, second, third, fourth = stored.gop_stats
        assert second.bytes < 0.6 * first.bytes
        assert fourth.bytes < 0.6 * third.bytes
        # Prediction does not pay by losing quality: three seeds had 30.4 to 30.9 dB.
        assert min(second.psnr, fourth.psnr) > 30
        items = {item.name: item.bytes for item in inspect_bytes(place(stored))}
        assert items["mode"] > 0
        assert sum(items.values()) == stored.bytes

    def test_better_than_key_gops_of_the_same_size(self, film: Path, tmp_path: Path) -> None:
        qualities, sizes = [], []
        for keyint in (0, 4):
            settings = {**SETTINGS, "keyint": keyint, "bpp": 0.3, "pack": "deflate"}
            result = gsvrcodec.encode(film, tmp_path / f"{keyint}.gsvr", **settings)
            qualities.append(result.psnr)
            sizes.append(result.bpp)
        assert sizes == pytest.approx([0.3, 0.3], rel=0.04)
        assert qualities[1] > qualities[0] + 1


class TestDecoded:
    def test_figures_are_those_of_the_file(self, film: Path, stored: EncodeResult) -> None:
        with gsvrcodec.open(place(stored)) as decoder:
            values = [
                making.psnr(frame.data, shot)
                for frame, shot in zip(decoder, locked_camera(16), strict=True)
            ]
        assert np.mean(values) == pytest.approx(stored.psnr, abs=0.02)
        for gop in stored.gop_stats:
            own = values[gop.first_frame : gop.first_frame + gop.frames]
            assert np.mean(own) == pytest.approx(gop.psnr, abs=0.02)

    def test_any_frame_by_itself(self, stored: EncodeResult) -> None:
        with gsvrcodec.open(place(stored)) as decoder:
            frames = [frame.data for frame in decoder]
        for number in (15, 0, 9, 6):
            with gsvrcodec.open(place(stored)) as decoder:
                np.testing.assert_array_equal(decoder[number].data, frames[number])

    def test_damage_costs_the_rest_of_its_chain(self, stored: EncodeResult, tmp_path: Path) -> None:
        """A damaged key GOP costs its chain, a damaged predicted GOP itself; the rest stays."""
        with gsvrcodec.open(place(stored)) as decoder:
            frames = [frame.data for frame in decoder]
        with GsvrReader(place(stored)) as reader:
            chunks = [gop.chunk for gop in reader.gops]
        for number, lost in ((0, range(8)), (1, range(4, 8)), (2, range(8, 16))):
            data = bytearray(place(stored).read_bytes())
            data[chunks[number].payload_offset + 100] ^= 8
            target = tmp_path / f"{number}.gsvr"
            target.write_bytes(data)
            with gsvrcodec.open(target, keep_going=True) as decoder:
                found = {frame.index: frame.data for frame in decoder}
            assert sorted(found) == [n for n in range(16) if n not in lost]
            for index, picture in found.items():
                np.testing.assert_array_equal(picture, frames[index])
            with (
                gsvrcodec.open(target) as decoder,
                pytest.raises(CorruptError, match=f"byte {chunks[number].offset}"),
            ):
                decoder[lost[-1]]
