"""Bits that refine the values of Gaussians, alone and behind the planes of a GOP."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gsvrcodec.bitstream.chunk import GOP_TYPE
from gsvrcodec.bitstream.gop_payload import pack_gop
from gsvrcodec.bitstream.refinement_bits import (
    TABLE_BYTES,
    pack_numbers,
    pack_table,
    parse_table,
    unpack_numbers,
)
from gsvrcodec.errors import CorruptError, GsvrError
from gsvrcodec.model.attributes import ATTRIBUTES
from gsvrcodec.model.order import strip_order
from gsvrcodec.model.quantise import Refined, bits_of, dequantised, refinements_of
from gsvrcodec.model.refinement import REFINED as NAMES
from gsvrcodec.model.refinement import Refinement
from gsvrcodec.model.static import select_gaussians
from tests.gops import (
    REFINED,
    assert_gops_equal,
    decode_all,
    make_file,
    make_gop,
    make_payload,
)
from tests.tampering import Piece, joined, pieces

REFINEMENTS = st.builds(Refinement, st.integers(-128, 127), st.integers(1, 8))


class TestTable:
    @given(table=st.dictionaries(st.sampled_from(NAMES), REFINEMENTS))
    def test_comes_back(self, table: dict[str, Refinement]) -> None:
        data = pack_table(table)
        assert len(data) == TABLE_BYTES
        assert parse_table(data) == table
        assert list(parse_table(data)) == [name for name in NAMES if name in table]

    def test_bytes(self) -> None:
        table = {"position": Refinement(-2, 3), "quadratic": Refinement(5, 8)}
        assert pack_table(table).hex() == "fe03" + 8 * "00" + "0508"

    @pytest.mark.parametrize("data", [b"", bytes(TABLE_BYTES - 1), b"\0\x09" + bytes(10)])
    def test_a_bad_table_fails(self, data: bytes) -> None:
        with pytest.raises(CorruptError, match="refinement"):
            parse_table(data)


class TestNumbers:
    @given(bits=st.lists(st.integers(0, 8), max_size=50), seed=st.integers(0, 2**32))
    def test_come_back(self, bits: list[int], seed: int) -> None:
        each = np.array(bits, np.int8)
        numbers = np.random.default_rng(seed).integers(0, 2 ** each.astype(int)).astype(np.uint8)
        data = pack_numbers(numbers, each)
        assert len(data) == -(-each.sum() // 8)
        np.testing.assert_array_equal(unpack_numbers(data, each), numbers)

    def test_the_highest_bit_comes_first(self) -> None:
        data = pack_numbers(
            np.array([0b110, 0, 0b01, 0b1010_0101], np.uint8), np.array([3, 0, 2, 8], np.int8)
        )
        assert data == bytes([0b11001_101, 0b00101_000])

    def test_bytes_fit_the_bits(self) -> None:
        bits = np.array([3], np.int8)
        assert unpack_numbers(b"\xa0", bits).tolist() == [0b101]
        assert unpack_numbers(b"", bits[:0]).size == 0
        for data in (b"\xa0\0", b"", b"\xb0", b"\xa1"):
            with pytest.raises(CorruptError, match="refinement"):
                unpack_numbers(data, bits)
        with pytest.raises(CorruptError, match="refinement"):
            unpack_numbers(b"\xa0", 3 * bits)


class TestPlanes:
    def test_decoded_as_the_encoder_expects(self) -> None:
        gop = make_gop(60, (3, 2, 4))
        payload = pack_gop(gop, np.arange(3), np.ones(3, np.int64), 0, REFINED)
        (content,) = decode_all(make_file([payload]))
        order = strip_order(gop.position)
        assert_gops_equal(content.gop, dequantised(select_gaussians(gop, order), REFINED))

    def test_each_bit_halves_the_error(self) -> None:
        gop = make_gop(500)
        refined = {name: own for name, own in REFINED.items() if isinstance(own, Refined)}
        plain = {name: Refined(own.steps, Refinement()) for name, own in refined.items()}
        base, finer = (dequantised(gop, {**REFINED, **each}) for each in (plain, refined))
        values = {attribute.name: getattr(base, attribute.name) for attribute in ATTRIBUTES}
        for name, bits in bits_of(values, refinements_of(REFINED)).items():
            assert 0 < bits.mean() < refined[name].refinement.most
            error = (getattr(finer, name) - getattr(gop, name)).reshape(500, -1)
            if name == "rotation":  # of period pi
                error = (error + np.pi / 2) % np.pi - np.pi / 2
            cell = refined[name].steps[0] * 2.0 ** -bits[:, None]
            assert (np.abs(error) / cell).max() > 0.4
            assert (np.abs(error) <= 0.501 * cell).all()

    def test_static_gaussians_have_no_bits_of_motion(self) -> None:
        gop = make_gop(40)
        still = replace(
            gop,
            indicator=np.ones_like(gop.indicator),
            linear=np.zeros_like(gop.linear),
            quadratic=np.zeros_like(gop.quadratic),
        )
        assert not dequantised(still, REFINED).linear.any()

    def test_values_stay_within_the_bounds(self) -> None:
        """-1024.9 is in the cell of -1024, and refined it would be -1024.875."""
        gop = make_gop(8)
        gop.position[1:] = -1024.9
        precision = {**REFINED, "position": Refined((2.0, 2.0), Refinement(-128, 3))}
        payload = pack_gop(gop, np.arange(1), np.ones(1, np.int64), 0, precision)
        (content,) = decode_all(make_file([payload]))
        for found in (content.gop, dequantised(gop, precision)):
            assert (found.position == -1024).sum() == 14

    def test_every_changed_byte_is_refused_or_stays_finite(self) -> None:
        payload = make_payload(30, (3, 2, 4), bits=REFINED, pack="entropy")
        head, _, *rest = pieces(make_file([payload]))
        rng = np.random.default_rng(4)
        refused = 0
        for offset in range(len(payload)):
            changed = bytearray(payload)
            changed[offset] ^= int(rng.integers(1, 256))
            try:
                (found,) = decode_all(joined([head, Piece(GOP_TYPE, bytes(changed)), *rest]))
            except GsvrError:
                refused += 1
                continue
            for attribute in ATTRIBUTES:
                values = getattr(found.gop, attribute.name)
                assert np.isfinite(values).all()
                assert values.min(initial=0) >= attribute.low
                assert values.max(initial=0) <= attribute.high
        assert refused > 0.3 * len(payload)
