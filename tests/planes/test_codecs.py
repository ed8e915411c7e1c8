"""All plane codecs alike: what goes in comes out, and nothing else is let in."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from gsvrcodec.errors import CorruptError, GsvrError, LimitError, UnsupportedError
from gsvrcodec.limits import Limits
from gsvrcodec.native import _entropy
from gsvrcodec.planes import (
    PACKS,
    Codec,
    CodedPlane,
    DamagedPlane,
    PlaneStack,
    Stack,
    decode_plane,
    decode_planes,
    encode_plane,
)
from gsvrcodec.planes.samples import Samples

LIMITS = Limits()
EVERY_CODEC = pytest.mark.parametrize("codec", list(Codec), ids=lambda codec: codec.name.lower())
CODECS_OF_GRIDS = [Codec.DEFLATE, Codec.CONTEXT, Codec.CONSTANT, Codec.CONTEXT, Codec.RANGES]
VARYING_CODECS: list[Codec] = [codec for codec in Codec if codec is not Codec.CONSTANT]


@st.composite
def planes(draw: st.DrawFn) -> tuple[Samples, int]:
    bits = draw(st.integers(1, 16))
    shape = draw(st.tuples(st.integers(1, 12), st.integers(1, 12)))
    samples = draw(arrays(np.uint16, shape, elements=st.integers(0, 2**bits - 1)))
    return samples, bits


def smooth(height: int, width: int, bits: int) -> Samples:
    ramp = np.add.outer(3 * np.arange(height), np.arange(width))
    noise = np.random.default_rng(0).integers(0, 4, ramp.shape)
    return ((ramp + noise) % (1 << bits)).astype(np.uint16)


class TestRoundTrip:
    @settings(max_examples=60)
    @given(plane=planes(), pack=st.sampled_from(sorted(PACKS)))
    def test_any_plane(self, plane: tuple[Samples, int], pack: str) -> None:
        samples, bits = plane
        codec, data = encode_plane(samples, bits, PACKS[pack])
        assert codec in PACKS[pack]
        height, width = samples.shape
        found = decode_plane(codec, data, width, height, bits, LIMITS)
        assert found.dtype == np.uint16
        np.testing.assert_array_equal(found, samples)

    @pytest.mark.parametrize("codec", VARYING_CODECS)
    @pytest.mark.parametrize("bits", [1, 8, 9, 12, 13, 16])
    @pytest.mark.parametrize("shape", [(1, 300), (300, 1), (37, 41), (256, 257)])
    def test_larger_planes(self, codec: Codec, bits: int, shape: tuple[int, int]) -> None:
        samples = smooth(*shape, bits)
        found, data = encode_plane(samples, bits, {codec})
        assert found is codec
        decoded = decode_plane(codec, data, shape[1], shape[0], bits, LIMITS)
        np.testing.assert_array_equal(decoded, samples)

    def test_the_smallest_codec_wins(self) -> None:
        samples = smooth(50, 60, 13)
        sizes: dict[Codec, int] = {
            codec: len(encode_plane(samples, 13, {codec})[1]) for codec in VARYING_CODECS
        }
        codec, data = encode_plane(samples, 13, set(Codec))
        assert len(data) == sizes[codec] == min(sizes.values())

    def test_the_automatic_choice_needs_no_image_codec(self) -> None:
        samples = smooth(50, 60, 13)
        codec, _ = encode_plane(samples, 13)
        assert codec in PACKS["auto"]
        assert not {Codec.PNG, Codec.JXL} & PACKS["auto"]

    def test_a_constant_plane_takes_two_bytes(self) -> None:
        samples = np.full((99, 99), 4711, np.uint16)
        assert encode_plane(samples, 13, PACKS["jxl"]) == (Codec.CONSTANT, b"\x67\x12")


class TestEncode:
    def test_a_sample_over_the_bits_fails(self) -> None:
        with pytest.raises(ValueError, match="sample 16 in a plane of 4 bits"):
            encode_plane(np.full((2, 2), 16, np.uint16), 4)

    @pytest.mark.parametrize(
        "samples", [np.zeros(4, np.uint16), np.zeros((0, 4), np.uint16), np.zeros((2, 2), np.int64)]
    )
    def test_another_shape_or_type_fails(self, samples: Samples) -> None:
        with pytest.raises(ValueError, match="a plane is a uint16 array of two axes"):
            encode_plane(samples, 8)

    def test_deflate_codes_what_the_others_cannot(self) -> None:
        assert encode_plane(smooth(3, 3, 8), 8, {Codec.CONSTANT})[0] is Codec.DEFLATE


def coded_grids() -> tuple[bytes, list[CodedPlane], list[Stack]]:
    """Planes of all codecs of a decoder without libraries, in two grids, and what they hold."""
    draw = np.random.default_rng(0)
    sizes, guided = [(5, 9), (8, 3)], [True, False]
    grids = [PlaneStack(5, *size, guided=own) for size, own in zip(sizes, guided, strict=True)]
    data, coded = b"", []
    for place, codec in enumerate(CODECS_OF_GRIDS):
        for number, grid in enumerate(grids):
            samples = draw.integers(0, 2**9, sizes[number]).astype(np.uint16)
            if codec is Codec.CONSTANT:
                samples[:] = 511
            _, part = encode_plane(samples, 9, {codec}, grid.prior)
            grid.append(samples)
            coded.append(CodedPlane(codec, 9, len(data), len(part), number, place))
            data += part
    stacks = [Stack(grid.prior.planes, own) for grid, own in zip(grids, guided, strict=True)]
    return data, coded, stacks


class TestDecodePlanes:
    def test_planes_of_several_grids(self) -> None:
        """Those of codec 4 see the planes before them, whatever codec these have."""
        data, coded, wanted = coded_grids()
        found = [Stack(np.zeros_like(stack.samples), stack.guided) for stack in wanted]
        decode_planes(data, coded, found)
        for stack, expected in zip(found, wanted, strict=True):
            np.testing.assert_array_equal(stack.samples, expected.samples)

    @pytest.mark.parametrize("number", range(2 * len(CODECS_OF_GRIDS)))
    def test_a_damaged_plane_is_named(self, number: int) -> None:
        data, coded, stacks = coded_grids()
        coded[number] = coded[number]._replace(size=coded[number].size - 1)
        with pytest.raises(DamagedPlane) as raised:
            decode_planes(data, coded, stacks)
        assert raised.value.number == number
        assert raised.value.error.section is not None

    @pytest.mark.parametrize(
        ("field", "value", "says"),
        [
            ("bits", 17, "1 to 16 bits"),
            ("size", 10**6, "out of range"),
            ("offset", 10**6, "out of range"),
            ("stack", 2, "no place"),
            ("place", 5, "no place"),
            ("place", -1, "no place"),
            ("codec", 1, "own codecs"),
        ],
    )
    def test_the_core_checks_what_it_is_told(self, field: str, value: int, says: str) -> None:
        data, coded, stacks = coded_grids()
        fields = coded[2]._asdict() | {field: value}
        plane = CodedPlane._make(fields.values())
        with pytest.raises(ValueError, match=says):
            _entropy.decode_planes(data, [plane], stacks)


class TestDecode:
    @pytest.mark.parametrize("codec", [6, 127, 255])
    def test_an_unknown_codec_is_unsupported(self, codec: int) -> None:
        with pytest.raises(UnsupportedError, match=f"unknown plane codec {codec}"):
            decode_plane(codec, b"", 1, 1, 8, LIMITS)

    @EVERY_CODEC
    def test_over_the_limit_nothing_is_looked_at(self, codec: Codec) -> None:
        with pytest.raises(LimitError, match="GSVR_LIMIT_PLANE_SAMPLES"):
            decode_plane(codec, b"", 2**13, 2**14, 8, LIMITS)

    @EVERY_CODEC
    @pytest.mark.parametrize("size", [(0, 1, 8), (1, 0, 8), (1, 1, 0), (1, 1, 17)])
    def test_an_impossible_plane_fails(self, codec: Codec, size: tuple[int, int, int]) -> None:
        with pytest.raises(CorruptError, match="plane of"):
            decode_plane(codec, b"", *size, LIMITS)

    @EVERY_CODEC
    def test_every_cut_and_every_extra_byte_fails(self, codec: Codec) -> None:
        samples = np.full((6, 7), 3, np.uint16) if codec is Codec.CONSTANT else smooth(6, 7, 10)
        _, data = encode_plane(samples, 10, {codec})
        wrong = [data[:size] for size in range(len(data))]
        wrong += [data + b"\0", data + b"\xff", data + data]
        for attempt in wrong:
            with pytest.raises(CorruptError):
                decode_plane(codec, attempt, 7, 6, 10, LIMITS)

    @pytest.mark.parametrize("codec", VARYING_CODECS)
    @pytest.mark.parametrize("size", [(5, 7), (7, 7), (8, 6), (1, 1), (2**13, 2**12)])
    def test_another_size_fails(self, codec: Codec, size: tuple[int, int]) -> None:
        _, data = encode_plane(smooth(6, 7, 10), 10, {codec})
        with pytest.raises(CorruptError):
            decode_plane(codec, data, *size, 10, LIMITS)

    @pytest.mark.parametrize("codec", [Codec.CONSTANT, Codec.PNG, Codec.JXL])
    @pytest.mark.parametrize(("bits", "declared"), [(8, 7), (16, 13)])
    def test_a_sample_over_the_declared_bits_fails(
        self, codec: Codec, bits: int, declared: int
    ) -> None:
        samples = smooth(9, 9, bits)
        samples[-1, -1] = 2**bits - 1
        if codec is Codec.CONSTANT:
            samples[:] = 2**bits - 1
        _, data = encode_plane(samples, bits, {codec})
        with pytest.raises(CorruptError, match=f"in a plane of {declared} bits"):
            decode_plane(codec, data, 9, 9, declared, LIMITS)

    @pytest.mark.parametrize("codec", [Codec.PNG, Codec.JXL])
    @pytest.mark.parametrize(("bits", "declared"), [(8, 9), (9, 8)])
    def test_eight_bits_for_sixteen_fail_and_the_other_way(
        self, codec: Codec, bits: int, declared: int
    ) -> None:
        _, data = encode_plane(smooth(9, 9, 8), bits, {codec})
        with pytest.raises(CorruptError):
            decode_plane(codec, data, 9, 9, declared, LIMITS)

    @settings(max_examples=150)
    @given(codec=st.sampled_from(list(Codec)), data=st.binary(max_size=80))
    def test_random_bytes_raise_our_errors_alone(self, codec: Codec, data: bytes) -> None:
        try:
            found = decode_plane(codec, data, 5, 4, 9, LIMITS)
        except GsvrError:
            return
        assert found.shape == (4, 5)
        assert found.max() < 2**9

    @pytest.mark.parametrize("codec", VARYING_CODECS)
    @settings(max_examples=150)
    @given(at=st.integers(0), value=st.integers(0, 255))
    def test_changed_bytes_raise_our_errors_or_stay_in_range(
        self, codec: Codec, at: int, value: int
    ) -> None:
        _, good = encode_plane(smooth(20, 20, 10), 10, {codec})
        data = bytearray(good)
        data[at % len(data)] = value
        try:
            found = decode_plane(codec, bytes(data), 20, 20, 10, LIMITS)
        except GsvrError:
            return
        assert found.shape == (20, 20)
        assert found.max() < 2**10
