"""Codec 1 against the words of the spec."""

from __future__ import annotations

import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gsvrcodec.errors import CorruptError
from gsvrcodec.planes import deflate
from gsvrcodec.planes.samples import PlaneShape
from tests import memory


def raw_deflate(data: bytes) -> bytes:
    deflater = zlib.compressobj(9, zlib.DEFLATED, -15)
    return deflater.compress(data) + deflater.flush()


class TestDecode:
    @given(st.data())
    def test_equals_the_reference_of_the_spec(self, data: st.DataObject) -> None:
        bits = data.draw(st.integers(1, 16))
        width, height = data.draw(st.integers(1, 6)), data.draw(st.integers(1, 6))
        cell = st.integers(0, 2**bits - 1)
        values = [[data.draw(cell) for _ in range(width)] for _ in range(height)]
        flat = [value for row in values for value in row]
        stream = bytes(v & 255 for v in flat)
        if bits > 8:
            stream += bytes(v >> 8 for v in flat)
        found = deflate.decode(b"\1" + raw_deflate(stream), PlaneShape(width, height, bits))

        sample = [[0] * width for _ in range(height)]
        for y in range(height):
            for x in range(width):
                v = values[y][x]
                difference = (v >> 1) ^ -(v & 1)
                before = sample[y][x - 1] if x else sample[y - 1][0] if y else 0
                sample[y][x] = (before + difference) % 2**bits
        assert found.tolist() == sample

    def test_predictor_0_is_plain_samples(self) -> None:
        found = deflate.decode(b"\0" + raw_deflate(b"\1\2\3\4\0\1\0\2"), PlaneShape(2, 2, 10))
        assert found.tolist() == [[1, 258], [3, 516]]

    @pytest.mark.parametrize("predictor", [2, 255])
    def test_an_unknown_predictor_fails(self, predictor: int) -> None:
        with pytest.raises(CorruptError, match=f"unknown predictor {predictor}"):
            deflate.decode(bytes([predictor]) + raw_deflate(b"\0"), PlaneShape(1, 1, 8))

    def test_a_stream_that_goes_on_stops_at_the_bound(self) -> None:
        bomb = b"\0" + raw_deflate(bytes(50_000_000))
        with memory.at_most(2**24), pytest.raises(CorruptError, match="does not hold 16 bytes"):
            deflate.decode(bomb, PlaneShape(4, 4, 8))

    def test_a_value_over_the_bits_fails_before_it_is_summed(self) -> None:
        with pytest.raises(CorruptError, match="sample 16 in a plane of 4 bits"):
            deflate.decode(b"\1" + raw_deflate(b"\x10"), PlaneShape(1, 1, 4))


class TestEncode:
    def test_steep_ramps_wrap_around(self) -> None:
        shape = PlaneShape(100, 100, 13)
        samples = (8191 * np.arange(10000).reshape(100, 100) % 8192).astype(np.uint16)
        data = deflate.encode(samples, shape)
        assert len(data) < 100
        np.testing.assert_array_equal(deflate.decode(data, shape), samples)
