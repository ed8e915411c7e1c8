"""The header chunk."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from typing import Any, get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gsvrcodec.bitstream.header import HEADER_BYTES, ColourInfo, Header, parse_header
from gsvrcodec.errors import CorruptError, GsvrError, LimitError, UnsupportedError
from gsvrcodec.limits import Limits
from gsvrcodec.model.reconstruction import Blending
from tests.gops import HEADER

BYTE = st.integers(0, 255)
WORD = st.integers(0, 2**16 - 1)
LIMITS = Limits()


@st.composite
def headers(draw: st.DrawFn) -> Header:
    positive = st.integers(1, 2**32 - 1)
    return Header(
        width=draw(st.integers(1, 32768)),
        height=draw(st.integers(1, 8192)),
        time_base=Fraction(draw(positive), draw(positive)),
        sample_aspect=Fraction(draw(positive), draw(positive)),
        rotation=draw(st.sampled_from([0, 90, 180, 270])),
        mirrored=draw(st.booleans()),
        bit_depth=draw(st.integers(1, 16)),
        colour=ColourInfo(
            draw(BYTE), draw(BYTE), draw(BYTE), draw(st.booleans()), draw(st.integers(0, 6))
        ),
        flags_optional=draw(st.integers(0, 2**32 - 1)),
        max_gaussians=draw(st.integers(0, 2**24)),
        max_gop_frames=draw(st.integers(0, 2**16)),
        max_grid=(draw(WORD), draw(WORD), draw(WORD)),
        frames=draw(st.integers(0, 2**64 - 1)),
        gops=draw(st.integers(0, 2**32 - 1)),
        blending=draw(st.sampled_from(get_args(Blending))),
    )


class TestHeader:
    @given(headers())
    def test_round_trip(self, header: Header) -> None:
        payload = header.to_bytes()
        assert len(payload) == HEADER_BYTES == 71
        assert parse_header(payload, LIMITS) == header

    @given(st.binary(min_size=HEADER_BYTES, max_size=HEADER_BYTES))
    def test_random_bytes_raise_our_errors_alone(self, payload: bytes) -> None:
        sound = b"\1\0\0\0\0\0\0\0" + payload[8:-2] + bytes([payload[-2] % 2, 0])
        for data in (payload, sound):
            try:
                header = parse_header(data, LIMITS)
            except GsvrError:
                continue
            # What is not an error survives; a fraction may come back in lowest terms.
            assert parse_header(header.to_bytes(), LIMITS) == header

    @pytest.mark.parametrize(
        ("field", "value", "says"),
        [
            ("width", 0, "picture size 0x48"),
            ("height", -1, "picture size 64x-1"),
            ("width", 2**32, "field is out of range"),
            ("rotation", 45, "rotation 45, expected"),
            ("bit_depth", 17, "bit depth 17, expected"),
            ("time_base", Fraction(0), "time base 0"),
            ("time_base", Fraction(1, 2**32), "field is out of range"),
            ("sample_aspect", Fraction(0), "sample aspect ratio 0"),
            ("colour", ColourInfo(chroma_location=7), "chroma location 7, expected"),
            ("colour", ColourInfo(primaries=256), "field is out of range"),
            ("max_grid", (2**16, 0, 0), "field is out of range"),
        ],
    )
    def test_writing_a_field_out_of_range_fails(self, field: str, value: Any, says: str) -> None:
        header = replace(HEADER, **{field: value})
        with pytest.raises(ValueError, match=says):
            header.to_bytes()

    @pytest.mark.parametrize("size", [0, 3, HEADER_BYTES - 2, HEADER_BYTES + 2])
    def test_another_length_fails(self, size: int) -> None:
        payload = HEADER.to_bytes().ljust(size, b"\0")[:size]
        with pytest.raises(CorruptError, match=f"header of {size} bytes"):
            parse_header(payload, LIMITS)

    @pytest.mark.parametrize(("size", "name"), [(70, "first"), (72, "second")])
    def test_a_header_of_a_release_candidate_is_named(self, size: int, name: str) -> None:
        payload = HEADER.to_bytes().ljust(size, b"\0")[:size]
        with pytest.raises(UnsupportedError, match=f"{name} release candidate.* encode the video"):
            parse_header(payload, LIMITS)

    def test_a_newer_version_is_no_release_candidate(self) -> None:
        newer = replace(HEADER, version_minor=1).to_bytes()
        with pytest.raises(CorruptError, match="header of 70 bytes, expected 71"):
            parse_header(newer[:70], LIMITS)
        assert parse_header(newer + b"\0", LIMITS).version == "1.1"

    @pytest.mark.parametrize("number", [2, 255])
    def test_another_way_to_form_pictures_is_unsupported(self, number: int) -> None:
        payload = bytearray(HEADER.to_bytes())
        payload[70] = number
        payload[12:16] = bytes(4)  # nor is a broken rule believed before it
        with pytest.raises(UnsupportedError, match=rf"does not know \({number}\)"):
            parse_header(bytes(payload), LIMITS)

    def test_a_longer_header_of_a_newer_minor_version_is_read(self) -> None:
        payload = replace(HEADER, version_minor=99).to_bytes() + b"more"
        assert parse_header(payload, LIMITS).version == "1.99"

    def test_another_major_version_names_both(self) -> None:
        payload = replace(HEADER, version_major=2, version_minor=3).to_bytes()
        with pytest.raises(UnsupportedError, match=r"version 2\.3, this decoder reads 1\.x"):
            parse_header(payload, LIMITS)

    @pytest.mark.parametrize(
        ("limit", "what"),
        [("width", "width"), ("height", "height"), ("pixels", "pixels"), ("gaussians", "Gaussian")],
    )
    def test_over_a_limit_names_the_variable(self, limit: str, what: str) -> None:
        payload = replace(HEADER, max_gaussians=50).to_bytes()
        with pytest.raises(LimitError, match=f"{what}.*GSVR_LIMIT_{limit.upper()}"):
            parse_header(payload, Limits(**{limit: 47}))
