"""Codec 2: which PNG files are planes."""

from __future__ import annotations

import struct
import zlib

import imagecodecs
import numpy as np
import pytest

from gsvrcodec.errors import CorruptError
from gsvrcodec.planes import png
from gsvrcodec.planes.samples import PlaneShape
from tests import memory

SHAPE = PlaneShape(4, 3, 8)
PIXELS = np.arange(12, dtype=np.uint8).reshape(3, 4)
ROWS = b"".join(b"\0" + row.tobytes() for row in PIXELS)


def chunk(kind: bytes, payload: bytes) -> bytes:
    crc = zlib.crc32(kind + payload)
    return struct.pack(">I", len(payload)) + kind + payload + struct.pack(">I", crc)


def ihdr(
    width: int = 4,
    height: int = 3,
    depth: int = 8,
    colour: int = 0,
    interlace: int = 0,
) -> bytes:
    return chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, depth, colour, 0, 0, interlace))


def file(*chunks: bytes) -> bytes:
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)


IDAT = chunk(b"IDAT", zlib.compress(ROWS))
IEND = chunk(b"IEND", b"")


class TestDecode:
    def test_a_plain_file_is_read(self) -> None:
        assert png.decode(file(ihdr(), IDAT, IEND), SHAPE).tolist() == PIXELS.tolist()

    def test_data_in_several_chunks_is_read(self) -> None:
        data = zlib.compress(ROWS)
        parts = [chunk(b"IDAT", data[i : i + 5]) for i in range(0, len(data), 5)]
        assert png.decode(file(ihdr(), *parts, IEND), SHAPE).tolist() == PIXELS.tolist()

    @pytest.mark.parametrize(
        ("data", "says"),
        [
            (file(IDAT, IEND), "first chunk is not"),
            (file(ihdr(), ihdr(), IDAT, IEND), "its only IHDR"),
            (file(ihdr(), IDAT), "without its end"),
            (file(ihdr(), IEND), "incomplete|does not hold"),
            (file(ihdr(), IDAT, IEND) + b"x", "1 bytes after the end"),
            (file(ihdr(), IDAT, IEND, IEND), "after the end"),
            (file(ihdr(), chunk(b"PLTE", bytes(6)), IDAT, IEND), "PLTE"),
            (file(ihdr(), chunk(b"tRNS", bytes(2)), IDAT, IEND), "tRNS"),
            (file(ihdr(), chunk(b"zTXt", b"a\0\0" + zlib.compress(b"")), IDAT, IEND), "zTXt"),
            (file(ihdr(width=5), IDAT, IEND), "PNG header"),
            (file(ihdr(width=2**31 - 1), IDAT, IEND), "PNG header"),
            (file(ihdr(depth=16), IDAT, IEND), "PNG header"),
            (file(ihdr(depth=4), IDAT, IEND), "PNG header"),
            (file(ihdr(colour=3), IDAT, IEND), "PNG header"),
            (file(ihdr(interlace=1), IDAT, IEND), "PNG header"),
            (file(ihdr()[:-1] + b"\0", IDAT, IEND), "CRC"),
            (file(ihdr(), chunk(b"IDAT", zlib.compress(ROWS[:-1])), IEND), "does not hold 15"),
            (file(ihdr(), chunk(b"IDAT", zlib.compress(ROWS + b"x")), IEND), "does not hold 15"),
            (file(ihdr(), chunk(b"IDAT", zlib.compress(ROWS) + b"x"), IEND), "does not hold 15"),
            (file(ihdr(), chunk(b"IDAT", zlib.compress(b"\5" + ROWS[1:])), IEND), "filter 5"),
            (file(ihdr(), struct.pack(">I4s", 2**32 - 1, b"IDAT") + bytes(40)), "past the end"),
        ],
    )
    def test_anything_else_fails(self, data: bytes, says: str) -> None:
        with pytest.raises(CorruptError, match=says):
            png.decode(data, SHAPE)

    @pytest.mark.parametrize("channels", [2, 3, 4])
    def test_colour_and_alpha_fail(self, channels: int) -> None:
        data = bytes(imagecodecs.png_encode(np.zeros((3, 4, channels), np.uint8)))
        with pytest.raises(CorruptError, match="PNG header"):
            png.decode(data, SHAPE)

    def test_a_bomb_stops_at_the_bound(self) -> None:
        bomb = chunk(b"IDAT", zlib.compress(bytes(50_000_000)))
        with memory.at_most(2**24), pytest.raises(CorruptError, match="does not hold 15"):
            png.decode(file(ihdr(), bomb, IEND), SHAPE)
