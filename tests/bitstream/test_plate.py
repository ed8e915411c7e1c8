"""Plates in payloads and files."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pytest

from gsvrcodec.bitstream.gop_chain import GopUnpacker
from gsvrcodec.bitstream.gop_head import parse_gop_head
from gsvrcodec.bitstream.gop_payload import (
    coded_plate,
    on_plate_of,
    pack_gop,
    plane_table,
    unpack_gop,
    unpack_plate,
)
from gsvrcodec.bitstream.header import PLATES_FLAG
from gsvrcodec.bitstream.plate import find_plate, plate_bytes
from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.bitstream.writer import GsvrWriter
from gsvrcodec.errors import CorruptError, LimitError
from gsvrcodec.limits import Limits
from gsvrcodec.model.plate import Plate
from tests.gops import (
    BITS,
    HEADER,
    assert_gops_equal,
    decode_all,
    make_carried,
    make_file,
    make_gop,
    make_modes,
)
from tests.vectors.streams import a_plate, plates, plates_kept

SIZE = HEADER.width, HEADER.height
PLATE = a_plate(*SIZE)
TIMES = np.array([0, 40]), np.array([40, 40])
FLAGGED = replace(HEADER, flags_required=PLATES_FLAG, max_gaussians=99, max_gop_frames=9)


def test_round_trip() -> None:
    """The GOP is as it would be without, and the plate is the same bytes."""
    payload = pack_gop(make_gop(9), *TIMES, 0, BITS, plate=PLATE)
    without = pack_gop(make_gop(9), *TIMES, 0, BITS)
    assert len(payload) == len(without) + 4 + len(PLATE)
    content = unpack_gop(payload, FLAGGED, Limits())
    assert content.plate == PLATE
    assert_gops_equal(content.new, unpack_gop(without, FLAGGED, Limits()).new)
    entries, offset, size = plane_table(payload, FLAGGED, Limits())
    assert (size, offset) == (len(PLATE), plane_table(without, FLAGGED, Limits())[1] + 4 + size)
    assert len(entries) == 14


def test_needs_the_flag() -> None:
    payload = pack_gop(make_gop(9), *TIMES, 0, BITS, plate=PLATE)
    with pytest.raises(CorruptError, match="flag of plates"):
        unpack_gop(payload, replace(FLAGGED, flags_required=0), Limits())


def test_only_key_gops_of_means() -> None:
    carried = make_carried(make_modes(9))
    with pytest.raises(ValueError, match="predicted GOP or a sum"):
        pack_gop(make_gop(3), *TIMES, 2, BITS, reference=2, carried=carried, plate=PLATE)
    with pytest.raises(ValueError, match="predicted GOP or a sum"):
        pack_gop(make_gop(3, blending="sum"), *TIMES, 0, BITS, blending="sum", plate=PLATE)
    with pytest.raises(ValueError, match="pictures are sums"):
        replace(FLAGGED, blending="sum").to_bytes()


@pytest.mark.parametrize("cut", range(4 + 3))
def test_cut(cut: int) -> None:
    part = plate_bytes(b"abc")
    assert find_plate(b"xx" + part, 2) == (b"abc", 2 + len(part))
    with pytest.raises(CorruptError, match="plate"):
        find_plate((b"xx" + part)[: 2 + cut], 2)
    assert plate_bytes(None) == b""


def test_chains() -> None:
    """A chain shares one plate; other key GOPs have their own or none."""
    first, second, third, fourth = decode_all(plates())
    assert first.plate is second.plate
    assert first.plate is not None
    assert third.plate is None
    assert fourth.plate is not None
    assert not np.array_equal(first.plate.ycc, fourth.plate.ycc)


@pytest.mark.parametrize("grid", [(0, 0, 0), (4, 3, 2)])
@pytest.mark.parametrize("gaussians", [0, 1, 24])
def test_a_key_gop_on_the_plate_of_another(gaussians: int, grid: tuple[int, int, int]) -> None:
    """It is the same in front of the plate, which it does not store any more."""
    root = pack_gop(make_gop(gaussians, seed=1), *TIMES, 0, BITS, plate=PLATE)
    own = pack_gop(make_gop(9, grid), TIMES[0] + 80, TIMES[1], 2, BITS, plate=PLATE)
    first, key = decode_all(make_file([root, own]))
    summary = parse_gop_head(root)
    moved = on_plate_of(own, summary)
    assert len(moved) < len(own) - len(PLATE) + 10
    head = parse_gop_head(moved)
    assert (head.reference, head.plate, head.dropped) == (2, False, gaussians)
    before, found = decode_all(make_file([root, moved]))
    assert found.plate is before.plate
    assert found.plate is not None
    assert first.plate is not None
    assert np.array_equal(found.plate.ycc, first.plate.ycc)
    assert_gops_equal(found.gop, key.gop)
    assert np.array_equal(found.pts, key.pts)
    assert found.kept is not None
    assert not found.kept.any()
    assert len(found.kept) == gaussians


def test_the_coded_plate_of_a_payload() -> None:
    assert coded_plate(pack_gop(make_gop(9), *TIMES, 0, BITS, plate=PLATE)) == PLATE
    assert coded_plate(pack_gop(make_gop(9), *TIMES, 0, BITS)) is None
    assert (
        coded_plate(pack_gop(make_gop(9, blending="sum"), *TIMES, 0, BITS, blending="sum")) is None
    )


def test_the_last_plate_is_decoded_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """However often GOPs in front of it are asked for in turn."""
    decoded: list[bytes] = []

    def counted(data: bytes, size: tuple[int, int] | None = None) -> Plate:
        decoded.append(data)
        return unpack_plate(data, size)

    monkeypatch.setattr("gsvrcodec.bitstream.gop_chain.unpack_plate", counted)
    with GsvrReader(io.BytesIO(plates_kept())) as reader:
        unpacker = GopUnpacker(reader, Limits())
        found = [unpacker.unpack(position).plate for position in (4, 1, 3, 0, 2)]
    assert len(decoded) == 1
    assert all(plate is found[0] for plate in found)


def test_the_writer_sets_the_flag_with_the_first_plate() -> None:
    payload = pack_gop(make_gop(9), *TIMES, 0, BITS, plate=PLATE)
    plain = pack_gop(make_gop(9), *TIMES, 0, BITS)
    for payloads, has in (([plain], False), ([payload], True)):
        file = io.BytesIO()
        with GsvrWriter(file, replace(HEADER, flags_required=PLATES_FLAG)) as writer:
            assert not writer.header.plates
            for one in payloads:
                writer.add_gop(one)
            assert writer.header.plates == has
    with pytest.raises(ValueError, match="plates or image codecs in a stream"):
        GsvrWriter(io.BytesIO(), HEADER, stream=True).add_gop(payload)


def test_bombs() -> None:
    """A few bytes of one colour are not decoded to a picture that is over the limit."""
    data = make_file([pack_gop(make_gop(0), *TIMES, 0, BITS, plate=PLATE)])
    assert decode_all(data, Limits(expansion_base=9300 - len(PLATE), expansion_ratio=1))
    with pytest.raises(LimitError, match="would expand to 9216 bytes"):
        decode_all(data, Limits(expansion_base=9200 - len(PLATE), expansion_ratio=1))


def test_of_another_size() -> None:
    with pytest.raises(CorruptError, match=r"GOPD.*not of the coded size"):
        decode_all(
            make_file([pack_gop(make_gop(3), *TIMES, 0, BITS, plate=a_plate(48, 64))], HEADER)
        )
    assert unpack_plate(a_plate(48, 64)).ycc.shape == (3, 64, 48)
