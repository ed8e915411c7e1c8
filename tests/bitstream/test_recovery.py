"""Files without a valid index."""

from __future__ import annotations

import io

import pytest

from gsvrcodec.bitstream.chunk import SIGNATURE, chunk_bytes, chunk_head
from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.errors import CorruptError, LimitError
from gsvrcodec.limits import Limits
from tests.gops import HEADER, make_file, make_payload, make_payloads
from tests.tampering import Piece, joined, pieces

PAYLOADS = make_payloads(4)
CHUNKS = pieces(make_file(PAYLOADS))


def recovered(data: bytes, limits: Limits | None = None) -> GsvrReader:
    reader = GsvrReader(io.BytesIO(data), limits or Limits())
    assert reader.recovered
    return reader


class TestRecovery:
    def test_without_index_all_gops_are_found(self) -> None:
        reader = recovered(joined(CHUNKS[:5], reindex=False))
        assert [reader.read_gop(n) for n in range(4)] == PAYLOADS
        assert "writing was not finished" in " ".join(reader.warnings)

    def test_a_cut_gop_is_left_out(self) -> None:
        reader = recovered(joined(CHUNKS[:5], reindex=False)[:-1])
        assert [reader.read_gop(n) for n in range(3)] == PAYLOADS[:3]
        assert reader.frames == 9

    def test_a_damaged_chunk_head_costs_its_gop_alone(self) -> None:
        data = bytearray(joined(CHUNKS[:5], reindex=False))
        data[data.index(PAYLOADS[1]) - 10] ^= 1
        reader = recovered(bytes(data))
        assert [gop.first_frame for gop in reader.gops] == [0, 6, 9]
        assert [reader.read_gop(n) for n in range(3)] == [PAYLOADS[0], *PAYLOADS[2:]]
        assert "frames 3 to 5 are lost" in reader.warnings
        assert reader.gop_of_frame(6) == 1
        with pytest.raises(CorruptError, match="frame 4 is lost"):
            reader.gop_of_frame(4)

    def test_the_first_gop_may_be_lost(self) -> None:
        reader = recovered(joined([CHUNKS[0], *CHUNKS[3:5]], reindex=False))
        with pytest.raises(CorruptError, match="frame 0 is lost"):
            reader.gop_of_frame(0)
        assert reader.gop_of_frame(6) == 0

    def test_a_repeated_gop_is_left_out(self) -> None:
        head, first, second, *_ = CHUNKS
        reader = recovered(joined([head, first, first, second, first], reindex=False))
        assert [gop.first_frame for gop in reader.gops] == [0, 3]
        assert "GOP left out" in " ".join(reader.warnings)

    def test_a_gop_whose_time_runs_back_is_left_out(self) -> None:
        late = Piece(b"GOPD", make_payload(5, first_frame=3, start_pts=80))
        reader = recovered(joined([*CHUNKS[:2], late], reindex=False))
        assert len(reader.gops) == 1

    def test_the_search_crosses_its_windows(self) -> None:
        for junk in (2**20 - 18, 2**20 - 17, 2**20 - 2, 2**20 - 1, 2**20, 2**21 + 1):
            data = joined(CHUNKS[:2], reindex=False) + bytes(junk) + CHUNKS[2].to_bytes()
            reader = recovered(data)
            assert [reader.read_gop(n) for n in range(2)] == PAYLOADS[:2]

    def test_nothing_after_the_end_is_read(self) -> None:
        reader = recovered(make_file(PAYLOADS[:1]) + CHUNKS[2].to_bytes())
        assert len(reader.gops) == 1

    def test_a_million_false_starts_are_over_a_limit(self) -> None:
        data = joined(CHUNKS[:2], reindex=False) + b"GOPD" * 1_000_000
        with pytest.raises(LimitError, match="look like a chunk"):
            recovered(data)

    def test_a_length_that_overflows_is_damage(self) -> None:
        for size in (2**64 - 1, 2**64 - 20, 2**63, 10**6):
            lie = chunk_head(b"GOPD", size)
            reader = recovered(joined(CHUNKS[:2], reindex=False) + lie + CHUNKS[2].to_bytes())
            assert len(reader.gops) == 2
            assert f"{size} bytes, past the end of the file" in " ".join(reader.warnings)

    def test_only_a_header_is_corrupt(self) -> None:
        data = SIGNATURE + chunk_bytes(b"HEAD", HEADER.to_bytes())
        with pytest.raises(CorruptError, match="no whole GOP"):
            recovered(data)
