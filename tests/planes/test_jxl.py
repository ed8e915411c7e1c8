"""Codec 3: which JPEG XL codestreams are planes."""

from __future__ import annotations

from typing import Any

import imagecodecs
import numpy as np
import pytest

from gsvrcodec.errors import CorruptError
from gsvrcodec.planes import PACKS, Codec, encode_plane, jxl
from gsvrcodec.planes.jxl_header import check_codestream
from gsvrcodec.planes.samples import PlaneShape

GREY = np.random.default_rng(0).integers(0, 255, (40, 50)).astype(np.uint8)
SHAPE = PlaneShape(50, 40, 8)


def encoded(pixels: Any, **options: Any) -> bytes:
    """A codestream with the options of the library, lossless unless they say otherwise."""
    options = {"lossless": True, "usecontainer": False, "numthreads": 1, **options}
    data = bytes(imagecodecs.jpegxl_encode(pixels, **options))
    if options["usecontainer"]:
        return data
    # The library boxes what is over 12 bits all the same: the codestream is the last box.
    box = data.find(b"jxlc")
    return data[box + 4 :] if box >= 0 else data


class TestDecode:
    @pytest.mark.parametrize("effort", range(1, 10))
    def test_every_effort_of_the_library_is_read(self, effort: int) -> None:
        found = jxl.decode(encoded(GREY, effort=effort), SHAPE)
        assert found.tolist() == GREY.tolist()

    @pytest.mark.parametrize(
        "size", [(1, 1), (8, 8), (16, 8), (9, 12), (600, 500), (1, 2000), (255, 256)]
    )
    def test_every_way_to_write_a_size_is_read(self, size: tuple[int, int]) -> None:
        pixels = np.arange(size[0] * size[1], dtype=np.uint8).reshape(size)
        check_codestream(encoded(pixels), PlaneShape(size[1], size[0], 8))
        with pytest.raises(CorruptError, match="JPEG XL image of"):
            check_codestream(encoded(pixels), PlaneShape(size[1] + 1, size[0], 8))

    @pytest.mark.parametrize(
        ("data", "says"),
        [
            (b"", "not a bare"),
            (b"\xff\x0a", "cut short"),
            (encoded(GREY, usecontainer=True), "not a bare"),
            (encoded(GREY.astype(np.uint16)), "16 bits, expected 8"),
            (encoded(GREY, bitspersample=7), "7 bits, expected 8"),
            (encoded(GREY, lossless=False, distance=1.0), "lossy"),
            (encoded(GREY, lossless=False, distance=0.1), "lossy"),
            (encoded(np.stack([GREY] * 2, -1)), "extra channels"),
            (encoded(np.stack([GREY] * 3, -1)), "colour"),
            (encoded(np.stack([GREY] * 4, -1)), "extra channels"),
            (encoded(np.stack([GREY] * 3)), "animation"),
            (encoded((GREY / 255).astype(np.float32)), "floating-point"),
            (encoded(np.zeros((4096, 4096), np.uint8)), "4096x4096, expected 50x40"),
        ],
    )
    def test_anything_else_fails(self, data: bytes, says: str) -> None:
        with pytest.raises(CorruptError, match=says):
            jxl.decode(data, SHAPE)

    @pytest.mark.parametrize("effort", [1, 3, 5, 7])
    @pytest.mark.parametrize("size", [(300, 300), (1100, 700), (40, 2048), (2048, 2047)])
    def test_many_groups_are_read(self, effort: int, size: tuple[int, int]) -> None:
        pixels = np.add.outer(np.arange(size[0]), 3 * np.arange(size[1])).astype(np.uint8)
        pixels[::7, ::11] = 0
        found = jxl.decode(encoded(pixels, effort=effort), PlaneShape(size[1], size[0], 8))
        np.testing.assert_array_equal(found, pixels)

    @pytest.mark.parametrize("size", [(40, 50), (300, 300)])
    @pytest.mark.parametrize("tail", [b"\0", b"\xff\x0a", bytes(1000)])
    def test_trailing_bytes_fail(self, size: tuple[int, int], tail: bytes) -> None:
        pixels = np.random.default_rng(1).integers(0, 255, size).astype(np.uint8)
        with pytest.raises(CorruptError, match="codestream of"):
            jxl.decode(encoded(pixels) + tail, PlaneShape(size[1], size[0], 8))

    def test_every_flipped_bit_of_the_head_is_refused_or_harmless(self) -> None:
        data = encoded(GREY)
        refused = 0
        for bit in range(16, 16 + 8 * 14):
            flipped = bytearray(data)
            flipped[bit // 8] ^= 1 << bit % 8
            try:
                found = jxl.decode(bytes(flipped), SHAPE)
            except CorruptError:
                refused += 1
                continue
            assert found.shape == GREY.shape
        assert refused > 20


class TestEncode:
    def test_what_the_library_makes_otherwise_is_not_used(self) -> None:
        # Over 2048 samples in a row or column the library permutes the sections.
        samples = np.arange(2049, dtype=np.uint16)[None] % 256
        assert jxl.encode(samples, PlaneShape(2049, 1, 8)) is None
        assert encode_plane(samples, 8, PACKS["jxl"])[0] is Codec.DEFLATE

    @pytest.mark.parametrize("bits", [8, 12, 13, 16])
    def test_writes_bare_codestreams(self, bits: int) -> None:
        shape = PlaneShape(50, 40, bits)
        samples = (GREY.astype(np.uint16) << (bits - 8)).astype(np.uint16)
        data = jxl.encode(samples, shape)
        assert data is not None
        assert data.startswith(b"\xff\x0a")
        np.testing.assert_array_equal(jxl.decode(data, shape), samples)
