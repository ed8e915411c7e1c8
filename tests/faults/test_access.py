"""Fault 23: whatever the order of access, the frames are those of a decoder that reads along."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import gsvrcodec
from gsvrcodec.decoder.decoder import Decoder
from tests import making

FRAMES = 24


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return making.gsvr_file(tmp_path_factory.mktemp("access") / "a.gsvr", frames=[5, 1, 7, 8, 3])


@pytest.fixture(scope="module")
def frames(path: Path) -> list[np.ndarray]:
    """What reading along gives."""
    with gsvrcodec.open(path) as decoder:
        return [frame.data for frame in decoder]


@pytest.fixture
def decoder(path: Path) -> Iterator[Decoder]:
    with gsvrcodec.open(path) as opened:
        yield opened


ORDERS = {
    "random": np.random.default_rng(0).permutation(FRAMES).tolist(),
    "backward": list(range(FRAMES - 1, -1, -1)),
    "repeated": [7, 7, 0, 7, 7],
    "last": [FRAMES - 1],
    "negative": [-1, -FRAMES, -5],
    "borders": [4, 5, 6, 5, 4, 12, 13],
}


@pytest.mark.parametrize("order", ORDERS.values(), ids=ORDERS)
class TestOrders:
    def test_one_at_a_time(
        self, decoder: Decoder, frames: list[np.ndarray], order: list[int]
    ) -> None:
        for index in order:
            np.testing.assert_array_equal(decoder[index].data, frames[index])

    def test_together(self, decoder: Decoder, frames: list[np.ndarray], order: list[int]) -> None:
        batch = decoder.get_frames_at(order)
        assert batch.index.tolist() == [index % FRAMES for index in order]
        for data, index in zip(batch.data, order, strict=True):
            np.testing.assert_array_equal(data, frames[index])


@pytest.mark.parametrize("index", [FRAMES, FRAMES + 1, -FRAMES - 1, 2**40, -(2**40)])
def test_out_of_range_fails(decoder: Decoder, index: int) -> None:
    with pytest.raises(IndexError, match=f"frame {index} of a video of {FRAMES} frames"):
        decoder[index]


def test_from_threads(decoder: Decoder, frames: list[np.ndarray]) -> None:
    order = np.random.default_rng(1).integers(0, FRAMES, 200).tolist()
    with ThreadPoolExecutor(8) as pool:
        for index, frame in zip(order, pool.map(decoder.get_frame_at, order), strict=True):
            np.testing.assert_array_equal(frame.data, frames[index])


def test_two_readers(path: Path, frames: list[np.ndarray]) -> None:
    with gsvrcodec.open(path) as first, gsvrcodec.open(path) as second:
        for ahead, behind in zip(first, reversed(range(FRAMES)), strict=True):
            np.testing.assert_array_equal(ahead.data, frames[ahead.index])
            np.testing.assert_array_equal(second[behind].data, frames[behind])


def test_after_close_fails(path: Path) -> None:
    decoder = gsvrcodec.open(path)
    frames = iter(decoder)
    next(frames)
    decoder.close()
    decoder.close()
    for use in (lambda: decoder[0], lambda: list(decoder), lambda: decoder.get_frames_at([])):
        with pytest.raises(ValueError, match="closed"):
            use()
    assert len(decoder) == FRAMES
