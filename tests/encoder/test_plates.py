"""Plates from end to end: when a film gets one, what it wins, and what reads it."""

from __future__ import annotations

import io
from fractions import Fraction
from typing import Any

import cv2
import numpy as np
import pytest

import gsvrcodec
from gsvrcodec.bitstream.gop_payload import unpack_gop, unpack_plate
from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.errors import UnsupportedError
from gsvrcodec.limits import Limits
from gsvrcodec.report.spending import spending
from tests.fit.test_plate import Frames, film, texture
from tests.making import psnr
from tests.tampering import patched

FILM = film(24)


def encoded(film: Frames = FILM, **options: Any) -> bytes:
    settings = {"fps": 30, "gop": 8, "preset": "fastest", "workers": 1, "threads": 2, **options}
    data = gsvrcodec.encode(film, None, **settings).data
    assert data is not None
    return data


def shown(data: bytes, **how: Any) -> np.ndarray[Any, np.dtype[np.uint8]]:
    with gsvrcodec.open(data, **how) as decoder:
        return np.stack([frame.data for frame in decoder])


@pytest.fixture(scope="module")
def with_plate() -> bytes:
    return encoded()


def test_texture_that_stands_still_gets_one(with_plate: bytes) -> None:
    """Better at fewer bytes than without, by a lower constant quality."""
    lower, without = encoded(crf=29), encoded(plates=False)
    assert psnr(shown(lower), FILM) > psnr(shown(without), FILM)
    assert len(lower) < len(without)
    with GsvrReader(io.BytesIO(with_plate)) as reader, GsvrReader(io.BytesIO(without)) as other:
        assert reader.header.plates
        assert not other.header.plates
        sizes = {item.name: item.bytes for item in spending(reader)}
        assert 0 < sizes["plates"] < len(with_plate)
        assert sum(sizes.values()) == len(with_plate)


def test_predicted_gops_have_that_of_their_key_gop(with_plate: bytes) -> None:
    with gsvrcodec.open(with_plate) as decoder:
        in_order = shown(with_plate)
        for number in (17, 0, 9, 23, 3):
            assert np.array_equal(decoder[number].data, in_order[number])
    with GsvrReader(io.BytesIO(with_plate)) as reader:
        assert [gop.is_key for gop in reader.gops] == [True] + [False] * (len(reader.gops) - 1)
        assert len(reader.gops) == 3


def test_it_shows_what_later_gops_uncover() -> None:
    """The box waits for a GOP: its place in the plate is that of the frames after it."""
    waiting = np.concatenate([np.repeat(FILM[:1], 8, axis=0), FILM])
    with GsvrReader(io.BytesIO(encoded(waiting))) as reader:
        plate = unpack_gop(reader.read_gop(0), None, Limits()).plate
    assert plate is not None
    box = np.s_[30:54, :24]
    assert psnr(unpack_plate(plate).shown()[box], texture()[box]) > 25


def test_the_static_layer_has_it(with_plate: bytes) -> None:
    static, dynamic = (shown(with_plate, layers=layers) for layers in ("static", "dynamic"))
    far = np.s_[0, 70:]  # where the box never is
    assert psnr(static[far], texture()[70:]) > 30
    assert psnr(dynamic[far], texture()[70:]) < 15


@pytest.mark.parametrize("size", [(80, 48), (320, 192), (100, 100)])
def test_sizes(with_plate: bytes, size: tuple[int, int]) -> None:
    with gsvrcodec.open(with_plate) as decoder:
        found = decoder.render(Fraction(4, 30), size)
    wanted = cv2.resize(FILM[4], size, interpolation=cv2.INTER_AREA)
    assert psnr(found, wanted) > 27


def test_the_same_in_any_process(with_plate: bytes) -> None:
    assert encoded(threads=1) == with_plate
    assert encoded(workers=2, threads=1) == with_plate


@pytest.mark.parametrize("options", [{"bpp": 0.2}, {"gaussians": 300}, {"profile": "paper"}])
def test_only_constant_quality_has_them(options: dict[str, Any]) -> None:
    if options.get("profile") == "paper":
        options = {**options, "gaussians": 300}
    with GsvrReader(io.BytesIO(encoded(**options))) as reader:
        assert not reader.header.plates


def test_streams_announce_them(with_plate: bytes) -> None:
    """A stream says so before its first GOP is known."""

    class Pipe(io.BytesIO):
        def seekable(self) -> bool:
            return False

    pipe = Pipe()
    gsvrcodec.encode(FILM, pipe, fps=30, gop=8, preset="fastest", workers=1, threads=2)
    with GsvrReader(io.BytesIO(pipe.getvalue())) as reader:
        assert reader.header.stream
        assert reader.header.plates
    assert np.array_equal(shown(pipe.getvalue()), shown(with_plate))


def test_older_decoders_refuse_them(with_plate: bytes) -> None:
    """What is unknown among the flags that must be understood is said with its number."""
    with pytest.raises(UnsupportedError, match="flags 0x00000002"):
        gsvrcodec.open(patched(with_plate, b"HEAD", 4, "I", 3))
