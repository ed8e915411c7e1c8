"""Predicted GOPs in a file: from the key GOP, from memory, and from damaged chains."""

from __future__ import annotations

import io
import random
from collections.abc import Sequence
from dataclasses import fields

import numpy as np
import pytest

from gsvrcodec.bitstream.chunk import GOP_TYPE
from gsvrcodec.bitstream.gop_chain import GopUnpacker
from gsvrcodec.bitstream.gop_head import GopSummary, parse_gop_head
from gsvrcodec.bitstream.gop_payload import pack_gop, unpack_gop
from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.bitstream.writer import GsvrWriter
from gsvrcodec.errors import CorruptError, LimitError
from gsvrcodec.limits import Limits
from tests.gops import (
    BITS,
    HEADER,
    assert_gops_equal,
    decode_all,
    make_carried,
    make_chain,
    make_file,
    make_gop,
    make_payloads,
)
from tests.tampering import Piece, joined, pieces

FRAMES = (3, 2, 1, 4, 2, 3)
CHAIN = make_chain(FRAMES)
FILE = make_file(CHAIN)
WHOLE = decode_all(FILE)
#: Two branches from the key GOP, and one from the middle of the first.
TREE = make_file(make_chain((3, 2, 2, 2, 2), references=(0, 1, 0, 1)))


def opened(data: bytes, limits: Limits | None = None) -> GsvrReader:
    return GsvrReader(io.BytesIO(data), limits or Limits())


class TestReader:
    def test_a_chain_goes_back_to_its_key_gop(self) -> None:
        reader = opened(FILE)
        assert [gop.is_key for gop in reader.gops] == [True] + [False] * 5
        assert [gop.reference for gop in reader.gops] == [0, *FRAMES[:-1]]
        assert reader.chain_of(0) == [0]
        assert reader.chain_of(4) == [0, 1, 2, 3, 4]
        assert reader.reference_of(0) is None
        assert reader.reference_of(3) == 2

    def test_a_gop_may_refer_to_any_earlier_one(self) -> None:
        reader = opened(TREE)
        assert [reader.chain_of(n) for n in range(5)] == [
            [0],
            [0, 1],
            [0, 1, 2],
            [0, 3],
            [0, 1, 4],
        ]
        assert len(decode_all(TREE)) == 5

    def test_a_long_chain_is_over_a_limit(self) -> None:
        assert len(opened(FILE, Limits(chain=6)).gops) == 6
        with pytest.raises(LimitError, match=r"is 6, over .*GSVR_LIMIT_CHAIN"):
            opened(FILE, Limits(chain=5))


class TestWriter:
    def test_a_missing_reference_fails(self) -> None:
        writer = GsvrWriter(io.BytesIO(), HEADER)
        writer.add_gop(make_payloads(1)[0])
        with pytest.raises(ValueError, match="first frame is 5, expected 3"):
            writer.add_gop(CHAIN[2])
        (third,) = make_chain((3, 2, 2), references=(0, 1))[2:]
        changed = bytearray(third)
        changed[0:8] = (3).to_bytes(8, "little")
        with pytest.raises(ValueError, match="frame 3 refers to frame 1, where no GOP starts"):
            writer.add_gop(bytes(changed))

    def test_a_reference_of_another_size_fails(self) -> None:
        writer = GsvrWriter(io.BytesIO(), HEADER)
        writer.add_gop(make_payloads(1)[0])
        with pytest.raises(ValueError, match="has 5 Gaussians, the GOP expects 30"):
            writer.add_gop(CHAIN[1])

    def test_flags_image_codecs(self) -> None:
        for pack, flag in (("png", True), ("jxl", True), ("entropy", False), ("deflate", False)):
            assert opened(make_file(make_chain(pack=pack))).header.image_codecs is flag

    def test_knows_the_most_gaussians(self) -> None:
        header = opened(FILE).header
        assert header.max_gaussians == max(len(whole.gop) for whole in WHOLE) == 30


class TestUnpacker:
    def test_every_mode_occurs(self) -> None:
        for payload in CHAIN[1:]:
            head = parse_gop_head(payload)
            assert min(head.dropped, head.changed, head.moved, head.new) > 0
            assert head.gaussians == head.carried_from - head.dropped + head.new
            carried = unpack_gop(payload, opened(FILE).header, Limits()).carried
            assert carried is not None
            assert set(carried.mode.tolist()) == {0, 1, 2, 3, 4}

    @pytest.mark.parametrize(
        "order",
        [range(6), range(5, -1, -1), [5, 0, 5, 3, 4, 1], random.Random(3).choices(range(6), k=40)],
        ids=["forwards", "backwards", "jumps", "random"],
    )
    def test_any_order_gives_the_same(self, order: Sequence[int]) -> None:
        reader = opened(FILE)
        unpacker = GopUnpacker(reader, Limits())
        for position in order:
            found = unpacker.unpack(position)
            assert found.first_frame == reader.gops[position].first_frame
            assert len(found.gop) == reader.gops[position].gaussians
            assert_gops_equal(found.gop, WHOLE[position].gop)

    def test_in_a_row_each_gop_is_read_once(self, monkeypatch: pytest.MonkeyPatch) -> None:
        reader = opened(FILE)
        read: list[int] = []
        original = GsvrReader.read_gop

        def read_gop(self: GsvrReader, position: int) -> bytes:
            read.append(position)
            return original(self, position)

        monkeypatch.setattr(GsvrReader, "read_gop", read_gop)
        unpacker = GopUnpacker(reader, Limits())
        for position in range(6):
            unpacker.unpack(position)
        assert read == list(range(6))
        GopUnpacker(reader, Limits()).unpack(3)
        assert read[6:] == [0, 1, 2, 3]
        known = {1: WHOLE[1], 4: WHOLE[4]}
        rest = GopUnpacker(reader, Limits()).up_to(3, known.get)
        assert [position for position, _ in rest] == read[10:] == [2, 3]

    def test_a_damaged_gop_costs_the_rest_of_its_chain_alone(self) -> None:
        key = make_payloads(1)[0]
        tail = bytearray(key)
        frames = sum(FRAMES)
        tail[0:8] = frames.to_bytes(8, "little")
        for offset in (16, 24):
            pts = int.from_bytes(key[offset : offset + 8], "little") + 40 * frames
            tail[offset : offset + 8] = pts.to_bytes(8, "little")
        data = make_file([*CHAIN, bytes(tail)])
        start = data.index(CHAIN[2])
        damaged = data[: start + 90] + bytes([data[start + 90] ^ 1]) + data[start + 91 :]
        reader = opened(damaged)
        assert not reader.recovered
        unpacker = GopUnpacker(reader, Limits())
        for position in (4, 0, 3, 1, 2, 6, 5):
            if position in (0, 1, 6):
                unpacker.unpack(position)
                continue
            with pytest.raises(CorruptError, match="CRC mismatch") as caught:
                unpacker.unpack(position)
            assert caught.value.offset == reader.gops[2].offset
            assert ("predicted from this one" in str(caught.value)) == (position > 2)

    def test_a_lost_reference_is_named(self) -> None:
        head, first, _, third, *rest = pieces(FILE)
        reader = opened(joined([head, first, third, *rest[:2]], reindex=False))
        assert reader.recovered
        assert [gop.first_frame for gop in reader.gops] == [0, 5, 6, 10]
        assert "1 GOPs are predicted from lost ones, the first at frame 5" in reader.warnings
        unpacker = GopUnpacker(reader, Limits())
        unpacker.unpack(0)
        for position in (1, 2, 3):
            with pytest.raises(
                CorruptError, match="frame 3 is lost, which the GOP at frame 5 is predicted from"
            ):
                unpacker.unpack(position)

    def test_bytes_of_the_chain_bound_its_gaussians(self) -> None:
        # Equal Gaussians take no bytes: each GOP is within the limit, but not all together.
        gop = make_gop(30)
        for field in fields(gop):
            getattr(gop, field.name)[...] = 0.5
        carried = make_carried(np.zeros(30, np.uint8))
        pts, durations = np.arange(2), np.ones(2, np.int64)
        data = make_file(
            [
                pack_gop(gop, pts, durations, 0, BITS),
                pack_gop(gop, pts + 2, durations, 2, BITS, reference=2, carried=carried),
            ]
        )
        limits = Limits(expansion_base=2000, expansion_ratio=1)
        unpacker = GopUnpacker(opened(data), limits)
        unpacker.unpack(0)
        with pytest.raises(LimitError, match="would expand to 3360 bytes"):
            unpacker.unpack(1)

    def test_nothing_of_a_damaged_gop_is_believed(self) -> None:
        """Without an index there is no other summary of a GOP than the one in its chunk."""
        chunks = pieces(FILE)[:7]
        data = bytearray(joined(chunks, reindex=False))
        payload = data.index(CHAIN[2])
        data[payload + 15] ^= 0x80
        reader = opened(bytes(data))
        assert [gop.first_frame for gop in reader.gops] == [0, 3, 6, 10, 12]
        assert f"GOPD at byte {payload - 16}" in " ".join(reader.warnings)
        unpacker = GopUnpacker(reader, Limits())
        unpacker.unpack(1)
        with pytest.raises(CorruptError, match="frame 5 is lost, which the GOP at frame 6"):
            unpacker.unpack(2)


class TestIndex:
    @pytest.mark.parametrize("reference", [1, 2, 4, 2**32 - 1])
    def test_a_reference_to_no_gop_is_not_believed(self, reference: int) -> None:
        chunks = pieces(FILE)
        changed = bytearray(chunks[2].payload)
        changed[40:44] = reference.to_bytes(4, "little")
        chunks[2] = Piece(GOP_TYPE, bytes(changed))
        reader = opened(joined(chunks))
        assert reader.recovered
        with pytest.raises(CorruptError):
            GopUnpacker(reader, Limits()).unpack(1)

    def test_a_summary_says_what_it_refers_to(self) -> None:
        summary = GopSummary(
            first_frame=9, frames=1, gaussians=0, start_pts=5, last_pts=5, last_duration=0
        )
        assert summary.is_key
        assert summary.reference_frame == 9
        with pytest.raises(CorruptError, match="reference 10 frames before frame 9"):
            GopSummary(
                first_frame=9,
                frames=1,
                gaussians=0,
                start_pts=5,
                last_pts=5,
                last_duration=0,
                reference=10,
            ).check()


def test_random_numbers_are_repeatable() -> None:
    assert make_chain(FRAMES) == CHAIN
    assert np.isfinite(WHOLE[-1].gop.position).all()
