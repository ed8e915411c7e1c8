"""Codec 3: which JPEG XL codestreams are planes."""

from __future__ import annotations

from typing import Any

import imagecodecs
import numpy as np
import pytest

from gsvrcodec.errors import CorruptError
from gsvrcodec.planes import jxl
from gsvrcodec.planes.jxl_header import check_codestream
from gsvrcodec.planes.samples import Shape

GREY = np.random.default_rng(0).integers(0, 255, (40, 50)).astype(np.uint8)
SHAPE = Shape(50, 40, 8)


def encoded(pixels: Any, **options: Any) -> bytes:
    """A codestream with the options of the library, lossless unless they say otherwise."""
    options = {"lossless": True, "usecontainer": False, "numthreads": 1, **options}
    data = bytes(imagecodecs.jpegxl_encode(pixels, **options))
    if options["usecontainer"]:
        return data
    # The library boxes what is over 12 bits all the same: the codestream is the last box.
    return data[max(data.find(b"jxlc"), -4) + 4 :]


class TestDecode:
    @pytest.mark.parametrize("effort", range(1, 10))
    def test_every_effort_of_the_library_is_read(self, effort: int) -> None:
        found = jxl.decode(encoded(GREY, effort=effort), SHAPE)
        assert found.tolist() == GREY.tolist()

    @pytest.mark.parametrize(
        "size", [(1, 1), (8, 8), (16, 8), (9, 12), (600, 500), (1, 8193), (255, 256)]
    )
    def test_every_way_to_write_a_size_is_read(self, size: tuple[int, int]) -> None:
        pixels = np.arange(size[0] * size[1], dtype=np.uint8).reshape(size)
        check_codestream(encoded(pixels), Shape(size[1], size[0], 8))
        with pytest.raises(CorruptError, match="JPEG XL image of"):
            check_codestream(encoded(pixels), Shape(size[1] + 1, size[0], 8))

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

    @pytest.mark.parametrize("size", [(40, 50), (300, 300)])
    @pytest.mark.parametrize("tail", [b"\0", b"\xff\x0a", bytes(1000)])
    def test_trailing_bytes_fail(self, size: tuple[int, int], tail: bytes) -> None:
        pixels = np.random.default_rng(1).integers(0, 255, size).astype(np.uint8)
        with pytest.raises(CorruptError, match="bytes after the end"):
            jxl.decode(encoded(pixels) + tail, Shape(size[1], size[0], 8))

    def test_every_flipped_bit_of_the_head_is_refused_or_harmless(self) -> None:
        data = encoded(GREY)
        for bit in range(16, 16 + 8 * 14):
            flipped = bytearray(data)
            flipped[bit // 8] ^= 1 << bit % 8
            try:
                found = jxl.decode(bytes(flipped), SHAPE)
            except CorruptError:
                continue
            assert found.shape == GREY.shape


class TestEncode:
    @pytest.mark.parametrize("bits", [8, 12, 13, 16])
    def test_writes_bare_codestreams(self, bits: int) -> None:
        shape = Shape(50, 40, bits)
        samples = (GREY.astype(np.uint16) << (bits - 8)).astype(np.uint16)
        data = jxl.encode(samples, shape)
        assert data is not None
        assert data.startswith(b"\xff\x0a")
        np.testing.assert_array_equal(jxl.decode(data, shape), samples)
