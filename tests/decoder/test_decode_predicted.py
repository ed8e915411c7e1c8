"""Predicted GOPs: any frame in any order, pictures between GOPs, damaged chains."""

from __future__ import annotations

import logging
import random
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

import gsvrcodec
from gsvrcodec import Decoder
from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.decoder import gop_cache
from gsvrcodec.decoder.gop_cache import LEAST_CACHED_GOPS
from gsvrcodec.errors import CorruptError
from gsvrcodec.model.layers import Layers
from gsvrcodec.model.reconstruction import Blending
from tests import making
from tests.decoder.film import GOPS, TIMES

BASE = Fraction(1, 90_000)


def film(directory: Path, blending: Blending) -> Path:
    return making.gsvr_file(
        directory / "a.gsvr",
        frames=GOPS,
        times=TIMES,
        time_base=BASE,
        predicted=True,
        blending=blending,
    )


@pytest.fixture(scope="module", params=get_args(Blending))
def path(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> Path:
    return film(tmp_path_factory.mktemp("predicted"), request.param)


@pytest.fixture
def decoder(path: Path) -> Iterator[Decoder]:
    with gsvrcodec.open(path) as decoder:
        yield decoder


@pytest.fixture(scope="module")
def sequence(path: Path) -> list[np.ndarray]:
    with gsvrcodec.open(path) as decoder:
        return [frame.data for frame in decoder]


def without(path: Path, position: int, target: Path) -> int:
    """Write the file with a damaged GOP; return the offset of its chunk."""
    with GsvrReader(path) as reader:
        entry = reader.gops[position]
    data = bytearray(path.read_bytes())
    data[entry.chunk.payload_offset + entry.size // 2] ^= 4
    target.write_bytes(data)
    return entry.offset


class TestFrames:
    def test_the_film_is_a_chain(self, path: Path) -> None:
        with GsvrReader(path) as reader:
            assert reader.chain_of(6) == list(range(7))

    def test_any_order_equals_the_sequence(self, path: Path, sequence: list[np.ndarray]) -> None:
        order = list(range(20)) * 2 + [19, 0, 19, 0, *range(19, -1, -1)]
        random.Random(1).shuffle(order)
        with gsvrcodec.open(path) as decoder:
            for index in order:
                assert np.array_equal(decoder[index].data, sequence[index])
        for index in (19, 7, 0):
            with gsvrcodec.open(path) as decoder:
                assert np.array_equal(decoder[index].data, sequence[index])

    def test_threads(self, decoder: Decoder, sequence: list[np.ndarray]) -> None:
        order = list(range(20)) * 4
        random.Random(2).shuffle(order)
        with ThreadPoolExecutor(8) as pool:
            for index, frame in zip(order, pool.map(decoder.get_frame_at, order), strict=True):
                assert np.array_equal(frame.data, sequence[index])

    def test_few_large_gops_in_memory(self, path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(gop_cache, "CACHED_BYTES", 1)
        with gsvrcodec.open(path) as decoder:
            decoder.get_frame_at(19)  # through all GOPs of the chain
            assert len(decoder._gops._cache) == LEAST_CACHED_GOPS
            last = decoder._gops.get(6)
            decoder.get_frame_at(0)
            assert decoder._gops.get(6) is last
            assert len(decoder._gops._cache) == LEAST_CACHED_GOPS

    def test_gops_on_the_way_stay_in_memory(self, decoder: Decoder) -> None:
        key = decoder._gops.get(0).whole
        decoder.get_frame_at(19)
        assert len(decoder._gops._cache) == 7
        assert decoder._gops.get(0).whole is key


class TestBetween:
    """GOP 0 ends with frame 4 at 19000 ticks, GOP 1 starts with frame 5 at 39920."""

    def test_goes_from_frame_to_frame(self, decoder: Decoder, sequence: list[np.ndarray]) -> None:
        last, first = TIMES[4][0], TIMES[5][0]
        for tick, frame in ((last, 4), (first, 5)):
            assert np.array_equal(decoder.render(tick * BASE), sequence[frame])
        for moment, frame in ((last + Fraction(1, 100), 4), (first - Fraction(1, 100), 5)):
            near = decoder.render(moment * BASE).astype(int)
            assert np.abs(near - sequence[frame]).max() <= 1

    def test_is_no_fade(self, decoder: Decoder, sequence: list[np.ndarray]) -> None:
        middle = Fraction(TIMES[4][0] + TIMES[5][0], 2)
        fade = (sequence[4].astype(int) + sequence[5]) / 2
        assert np.abs(decoder.render(middle * BASE) - fade).max() > 10

    def test_layers_of_sums_add_up(self, tmp_path: Path) -> None:
        path = film(tmp_path, "sum")
        middle = Fraction(TIMES[4][0] + TIMES[5][0], 2) * BASE
        layers: tuple[Layers, ...] = ("all", "dynamic", "static")
        pictures = []
        for name in layers:
            with gsvrcodec.open(path, layers=name) as decoder:
                pictures.append(decoder.render(middle).astype(int))
        whole, *parts = pictures
        inside = (parts[0] > 0) & (parts[1] > 0) & (whole < 255)
        assert inside.mean() > 0.1
        assert np.abs(parts[0] + parts[1] - whole)[inside].max() <= 1

    def test_streaming_equals_single_pictures(self, decoder: Decoder) -> None:
        times = [Fraction(1000 + 1317 * n) * BASE for n in range(117)]
        for number, picture in decoder.rendered(iter(times)):
            if not number % 7:
                assert np.array_equal(picture, decoder.render(times[number]))


class TestDamage:
    def test_costs_the_rest_of_the_chain(
        self,
        path: Path,
        tmp_path: Path,
        sequence: list[np.ndarray],
        caplog: pytest.LogCaptureFixture,
    ) -> None:
        damaged = tmp_path / "damaged.gsvr"
        offset = without(path, 2, damaged)
        with gsvrcodec.open(damaged) as decoder:
            assert np.array_equal(decoder[5].data, sequence[5])
            for index in (8, 19, 10):
                with pytest.raises(CorruptError, match=f"chunk GOPD at byte {offset}"):
                    decoder[index]
        with (
            caplog.at_level(logging.WARNING),
            gsvrcodec.open(damaged, keep_going=True) as decoder,
        ):
            assert [frame.index for frame in decoder] == list(range(6))
            assert decoder.lost_frames == 14
        assert "frames 6 to 9 are left out" in caplog.text
        assert "the GOP at frame 10 is predicted from this one" in caplog.text

    def test_a_lost_gop_costs_the_rest_of_the_chain(
        self, path: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
    ) -> None:
        data = path.read_bytes()
        with GsvrReader(path) as reader:
            chunk = reader.gops[1].chunk
        damaged = tmp_path / "damaged.gsvr"
        damaged.write_bytes(data[: chunk.offset] + data[chunk.end :])
        with (
            caplog.at_level(logging.WARNING),
            gsvrcodec.open(damaged, keep_going=True) as decoder,
        ):
            assert [frame.index for frame in decoder] == list(range(5))
            assert decoder.lost_frames == 15
        assert "frame 5 is lost, which the GOP at frame 6 is predicted from" in caplog.text
