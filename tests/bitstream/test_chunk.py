"""Signature and chunk framing."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gsvrcodec.bitstream import chunk
from gsvrcodec.errors import CorruptError, NotGsvrError


class TestChunk:
    def test_bytes_are_as_in_the_spec(self) -> None:
        assert chunk.chunk_bytes(b"fend", b"").hex(" ", 4) == (
            "66656e64 00000000 00000000 96d19853 00000000"
        )

    @given(kind=st.sampled_from([b"GOPD", b"abcd", b"Zzzz"]), payload=st.binary(max_size=64))
    def test_round_trip(self, kind: bytes, payload: bytes) -> None:
        data = chunk.chunk_bytes(kind, payload)
        entry = chunk.parse_chunk_head(data[: chunk.HEAD_BYTES], 100)
        assert entry == chunk.ChunkEntry(kind, 100, len(payload))
        assert entry.end == 100 + len(data)
        assert chunk.check_payload(entry, data[chunk.HEAD_BYTES :]) == payload

    @given(payload=st.binary(max_size=16), bit=st.integers(0, 8 * 16 - 1))
    def test_a_flipped_bit_of_the_head_fails(self, payload: bytes, bit: int) -> None:
        head = bytearray(chunk.chunk_head(b"GOPD", len(payload)))
        head[bit // 8] ^= 1 << bit % 8
        with pytest.raises(CorruptError, match="byte 7: damaged chunk head"):
            chunk.parse_chunk_head(bytes(head), 7)

    @pytest.mark.parametrize("kind", [b"GOP", b"GOP ", b"GOP1", b"G\xc3\x96PD", b"GOPDS"])
    def test_an_invalid_type_fails(self, kind: bytes) -> None:
        with pytest.raises(ValueError, match="four ASCII letters"):
            chunk.chunk_head(kind, 0)

    def test_case_of_the_first_letter_is_what_makes_a_chunk_critical(self) -> None:
        assert chunk.is_critical(b"Abcd")
        assert not chunk.is_critical(b"aBCD")


class TestSignature:
    def test_the_signature_passes(self) -> None:
        chunk.check_signature(chunk.SIGNATURE)

    @pytest.mark.parametrize(
        ("start", "cause"),
        [
            (b"", "it is empty"),
            (chunk.SIGNATURE[:3], "ends inside the signature"),
            (b"\x89GSV\n\x1a\nH", "line ends"),
            (b"\x89GSV\r\r\n\x1a", "line ends"),
            (b"\x09GSV\r\n\x1a\n", "7-bit"),
            (b"\0\0\0\x20ftyp", "the signature is missing"),
            (b"GSVR", "the signature is missing"),
        ],
    )
    def test_anything_else_fails_and_the_cause_is_named(self, start: bytes, cause: str) -> None:
        with pytest.raises(NotGsvrError, match=f"not a .gsvr file: .*{cause}"):
            chunk.check_signature(start)
