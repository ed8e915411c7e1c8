"""Codec 5 against the words of the spec."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from gsvrcodec.errors import CorruptError
from gsvrcodec.limits import Limits
from gsvrcodec.planes import Codec, decode_plane, ranges
from gsvrcodec.planes.samples import PlaneShape, Samples
from tests.planes.range_coder import Coder, Corrupt, unzigzag


def reference(data: bytes, shape: PlaneShape) -> Samples:
    """A plane as the spec's pseudo-code decodes it."""
    coder = Coder(data)
    lowest: list[int] = []
    highest: list[int] = []
    for y in range(shape.height):
        lowest.append((highest[y - 1] if y else 0) + unzigzag(coder.varint()))
        highest.append(lowest[y] + coder.varint())
        if lowest[y] < 0 or highest[y] >= 2**shape.bits:
            raise Corrupt
    coder.begin()
    sample = np.zeros((shape.height, shape.width), np.uint16)
    for y in range(shape.height):
        n = highest[y] - lowest[y] + 1
        for x in range(shape.width):
            value = coder.slot(16) * n >> 16
            start, end = ((v * 2**16 + n - 1) // n for v in (value, value + 1))
            coder.advance(16, start, end - start)
            sample[y, x] = lowest[y] + value
    coder.finish()
    return sample


def decoded(data: bytes, shape: PlaneShape) -> Samples:
    return decode_plane(Codec.RANGES, data, shape.width, shape.height, shape.bits, Limits())


class TestAgainstTheSpec:
    @settings(max_examples=100)
    @given(data=st.data())
    def test_any_plane(self, data: st.DataObject) -> None:
        bits = data.draw(st.integers(1, 16))
        size = data.draw(st.tuples(st.integers(1, 9), st.integers(1, 9)))
        cell = st.integers(0, 2**bits - 1)
        samples = data.draw(arrays(np.uint16, size, elements=cell))
        shape = PlaneShape(size[1], size[0], bits)
        stream = ranges.encode(samples, shape)
        np.testing.assert_array_equal(decoded(stream, shape), samples)
        np.testing.assert_array_equal(reference(stream, shape), samples)

    def test_all_values_of_all_bits(self) -> None:
        samples = np.arange(65536).astype(np.uint16).reshape(256, 256).T.copy()
        shape = PlaneShape(256, 256, 16)
        stream = ranges.encode(samples, shape)
        np.testing.assert_array_equal(decoded(stream, shape), samples)

    def test_bytes_of_a_small_plane(self) -> None:
        samples = np.array([[3, 5, 4], [6, 6, 6]], np.uint16)
        assert ranges.encode(samples, PlaneShape(3, 2, 4)).hex() == "0602020046551f00"


class TestDecode:
    @pytest.mark.parametrize(
        ("data", "says"),
        [
            ("", "cut short in its head"),
            ("01 00", "out of range"),
            ("00 10", "out of range"),
            ("ff ff ff ff 0f ff ff ff ff 0f", "out of range"),
            ("00 01 00 00 00", "cut short"),
            ("00 01 ff ff 00 00", "below its range"),
            ("00 00 00 00 01 00 00", "goes on"),
            ("00 01 01 00 01 00", "does not end where it must|cut short"),
        ],
    )
    def test_bad_data_fails(self, data: str, says: str) -> None:
        with pytest.raises(CorruptError, match=says):
            decoded(bytes.fromhex(data), PlaneShape(1, 1, 4))


class TestEncode:
    def test_noise_in_strips_takes_its_entropy(self) -> None:
        draw = np.random.default_rng(0)
        samples = (draw.integers(0, 41, (198, 198)) + 41 * np.arange(198)[:, None]).astype(
            np.uint16
        )
        size = len(ranges.encode(samples, PlaneShape(198, 198, 13)))
        assert size < samples.size * np.log2(41) / 8 + 2 * 198 + 20
