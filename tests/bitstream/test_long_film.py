"""A film of 100 000 frames: written in bounded memory, opened at once, read anywhere."""

from __future__ import annotations

import io
import tracemalloc
from pathlib import Path

import pytest

import gsvrcodec
from gsvrcodec.bitstream.gop_head import GOP_HEAD_BYTES
from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.bitstream.writer import GsvrWriter
from tests.benchmarks.ranges import Counted
from tests.gops import HEADER, make_payload, moved

GOPS, FRAMES = 6250, 16
#: Most bytes of a GOP, and of what the index has of it.
GOP_BYTES, ENTRY_BYTES = 512, 64


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("film") / "film.gsvr"
    payload = make_payload(3, frames=FRAMES)
    tracemalloc.start()
    with path.open("w+b") as file, GsvrWriter(file, HEADER) as writer:
        for gop in range(GOPS):
            writer.add_gop(moved(payload, gop, FRAMES))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert path.stat().st_size > GOPS * (GOP_HEAD_BYTES + 100)
    assert peak < 16 * 2**20
    return path


def test_the_size_is_known_before(film: Path) -> None:
    payload = make_payload(3, frames=FRAMES)
    writer = GsvrWriter(io.BytesIO(), HEADER)
    assert writer.final_size(GOPS, GOPS * len(payload)) == film.stat().st_size


def test_opens_at_once_and_small(film: Path) -> None:
    """By its index, of which a GOP has a few bytes."""
    file = Counted(film.read_bytes())
    GsvrReader(file).close()
    assert file.ranges < 10
    assert file.taken < ENTRY_BYTES * GOPS
    tracemalloc.start()
    with GsvrReader(film) as reader:
        assert reader.frames == 100_000
        assert tracemalloc.get_traced_memory()[1] < 16 * 2**20
    tracemalloc.stop()


def test_any_frame_is_near(film: Path) -> None:
    file = Counted(film.read_bytes())
    with gsvrcodec.open(file) as decoder:
        opened = file.taken
        for number, index in enumerate((0, 99_999, 50_000, 17), 1):
            assert decoder[index].index == index
            assert file.taken - opened < number * GOP_BYTES
        assert decoder.get_frame_played_at(2000.0).index == 50_000
