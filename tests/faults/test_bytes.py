"""Faults 1 to 9: bytes that are missing, damaged or lie about their number.

Single faults with files that can be kept are test vectors; see `tests/vectors/faulty`.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from gsvrcodec.bitstream.chunk import GOP_TYPE, HEAD_TYPE, INDEX_TYPE, SIGNATURE, chunk_head
from gsvrcodec.bitstream.plane_entries import take_entries
from gsvrcodec.errors import CorruptError, GsvrError, LimitError, NotGsvrError, UnsupportedError
from gsvrcodec.limits import Limits
from tests.cli.tools import Runner
from tests.faults.small import CHUNKS, FILE, FIRST, HEAD, PAYLOADS, opened
from tests.gops import decode_all, make_file, make_payload, make_payloads
from tests.tampering import MODES, TABLE_OFFSET, joined, patched


def intact_gops(data: bytes) -> list[int]:
    """Positions in PAYLOADS of the GOPs that can be read, each of them bit for bit."""
    try:
        reader = opened(data)
    except CorruptError:
        return []
    found = []
    for position, entry in enumerate(reader.gops):
        try:
            payload = reader.read_gop(position)
        except CorruptError:
            continue
        number = entry.first_frame // 3
        assert payload == PAYLOADS[number]
        found.append(number)
    return found


class TestNotOurFile:
    """Fault 1."""

    @pytest.mark.parametrize("size", range(8))
    def test_too_short(self, size: int) -> None:
        with pytest.raises(NotGsvrError, match=r"not a \.gsvr file"):
            opened(FILE[:size])

    @pytest.mark.parametrize(
        "data", [b"plain text\n" * 9, b"\0\0\0\x20ftypisom" + bytes(99), bytes(99)]
    )
    def test_something_else(self, data: bytes) -> None:
        with pytest.raises(NotGsvrError, match=r"not a \.gsvr file"):
            opened(data)


class TestTransfer:
    """Fault 2."""

    @pytest.mark.parametrize(
        ("change", "cause"),
        [
            (lambda data: data.replace(b"\r\n", b"\n"), "converts line ends"),
            (lambda data: data.replace(b"\n", b"\r\n"), "converts line ends"),
            (lambda data: bytes(byte & 0x7F for byte in data), "7-bit transfer"),
        ],
        ids=["CRLF to LF", "LF to CRLF", "7 bits"],
    )
    def test_the_likely_cause_is_named(self, change: Callable[[bytes], bytes], cause: str) -> None:
        with pytest.raises(NotGsvrError, match=f"not a .gsvr file: .*{cause}"):
            opened(change(FILE))


class TestTruncation:
    """Faults 3 and 4."""

    def test_every_cut_keeps_the_whole_gops_before_it(self) -> None:
        offset = len(SIGNATURE) + len(HEAD.to_bytes())
        ends = []
        for piece in CHUNKS[1:4]:
            offset += len(piece.to_bytes())
            ends.append(offset)
        for size in range(8, len(FILE)):
            whole = [number for number, end in enumerate(ends) if end <= size]
            assert intact_gops(FILE[:size]) == whole
            if whole:
                reader = opened(FILE[:size])
                assert reader.recovered
                assert reader.warnings
            else:
                with pytest.raises(CorruptError):
                    opened(FILE[:size])

    def test_no_index_is_recovered_with_a_warning(self) -> None:
        reader = opened(joined(CHUNKS[:4], reindex=False))
        assert reader.recovered
        assert reader.frames == 9
        assert "no valid index" in reader.warnings[0]

    def test_the_commands_say_so(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        cli, path = Runner(capsys), tmp_path / "a.gsvr"
        path.write_bytes(joined(CHUNKS[:4], reindex=False))
        info = cli("gsvrinfo", path)
        assert info.code == 0
        assert "gsvrinfo: warning: no valid index" in info.err
        assert "--keep-going" in cli.fails(3, "gsvrdec", path, tmp_path / "a.y4m", "-q")
        kept = cli("gsvrdec", path, tmp_path / "a.y4m", "-q", "--keep-going")
        assert kept.code == 5
        assert "9 frames were written" in kept.err


class TestBitFlips:
    """Faults 5 and 6."""

    @pytest.mark.parametrize("index", [True, False])
    @pytest.mark.parametrize("bit", range(8))
    def test_every_flip_is_detected_and_stays_in_its_gop(self, bit: int, index: bool) -> None:
        data = FILE if index else joined(CHUNKS[:5], reindex=False)
        start = len(SIGNATURE) + len(HEAD.to_bytes())
        ends = [start]
        for piece in CHUNKS[1:5]:
            ends.append(ends[-1] + len(piece.to_bytes()))
        for offset in range(len(data)):
            damaged = bytearray(data)
            damaged[offset] ^= 1 << bit
            if offset < start:
                with pytest.raises(GsvrError):
                    opened(bytes(damaged))
                continue
            hit = [n for n in range(3) if ends[n] <= offset < ends[n + 1]]
            assert intact_gops(bytes(damaged)) == [n for n in range(3) if n not in hit]
            reader = opened(bytes(damaged))
            if ends[3] <= offset < ends[4] and index:
                with pytest.raises(CorruptError, match="chunk sett"):
                    reader.settings()
            elif not hit or not index:
                assert reader.recovered

    @pytest.mark.parametrize("offset", range(0, 12_000, 1_000))
    def test_zeros_over_a_stretch_are_detected(self, offset: int) -> None:
        payloads = make_payloads(5, gaussians=200)
        data = make_file(payloads)
        size = min(4096, len(data) - offset)
        damaged = data[:offset] + bytes(size) + data[offset + size :]
        if offset < 8 + 20 + 70:
            with pytest.raises(CorruptError):
                opened(damaged)
            return
        reader = opened(damaged)
        whole = 0
        for position, entry in enumerate(reader.gops):
            try:
                payload = reader.read_gop(position)
            except CorruptError as error:
                assert f"chunk GOPD at byte {entry.offset}: damaged" in str(error)  # noqa: PT017
            else:
                assert payload == payloads[entry.first_frame // 3]
                whole += 1
        assert whole < 5 or reader.recovered


class TestAttacker:
    """Fault 7: every checksum is right."""

    def test_every_changed_byte_of_a_gop_is_refused_or_stays_finite(self) -> None:
        payload = make_payload(9, (2, 2, 2), pack="auto")
        good = make_file([payload])
        rng = np.random.default_rng(0)
        refused = 0
        for offset in range(len(payload)):
            value = int(rng.integers(1, 256))
            data = patched(good, GOP_TYPE, offset, "B", payload[offset] ^ value)
            try:
                (content,) = decode_all(data)
            except GsvrError:
                refused += 1
                continue
            for name in ("position", "log_scale", "rotation", "colour", "xy", "xt", "yt"):
                assert np.isfinite(getattr(content.gop, name)).all()
        assert refused > 0.4 * len(payload)

    def test_every_changed_byte_of_header_and_index_raises_our_errors_alone(self) -> None:
        for kind in (HEAD_TYPE, INDEX_TYPE):
            size = len(next(piece.payload for piece in CHUNKS if piece.type == kind))
            for offset in range(size):
                for value in (0, 1, 0x7F, 0x80, 0xFF):
                    data = patched(FILE, kind, offset, "B", value)
                    try:
                        decode_all(data)
                    except GsvrError:
                        continue

    @pytest.mark.parametrize("codec", ["png", "jxl", "deflate"])
    def test_changed_image_data_raises_our_errors_alone(self, codec: str) -> None:
        payload = make_payload(100, (8, 8, 8), pack=codec)
        _, begin = take_entries(payload, TABLE_OFFSET, MODES)
        rng = np.random.default_rng(1)
        for _ in range(300):
            damaged = bytearray(payload)
            for offset in rng.integers(begin, len(payload), 2):
                damaged[offset] = rng.integers(0, 256)
            try:
                decode_all(make_file([bytes(damaged)]))
            except GsvrError:
                continue


class TestLengths:
    """Faults 8 and 9."""

    @pytest.mark.parametrize("size", [10**6, 2**31, 2**63 - 1, 2**64 - 21, 2**64 - 20, 2**64 - 1])
    def test_a_length_past_the_end_is_refused_before_allocating(self, size: int) -> None:
        data = SIGNATURE + HEAD.to_bytes() + chunk_head(b"GOPD", size) + bytes(64)
        with pytest.raises(CorruptError, match=f"{size} bytes, past the end"):
            opened(data)
        with pytest.raises(CorruptError, match="header of"):
            opened(SIGNATURE + chunk_head(b"HEAD", size) + bytes(64))

    @pytest.mark.parametrize("size", [0, 2**32, 2**64 - 1, len(FIRST.payload) + 1])
    def test_a_wrong_length_in_the_index_leads_to_a_search(self, size: int) -> None:
        reader = opened(patched(FILE, INDEX_TYPE, 8, "Q", size))
        assert reader.recovered
        assert [reader.read_gop(n) for n in range(3)] == PAYLOADS

    @pytest.mark.parametrize("count", [0, 2, 5, 2**16 + 1, 2**31])
    def test_a_wrong_count_in_the_index_leads_to_a_search(self, count: int) -> None:
        reader = opened(patched(FILE, INDEX_TYPE, 0, "I", count))
        assert reader.recovered
        assert [reader.read_gop(n) for n in range(3)] == PAYLOADS

    def test_more_entries_than_the_limit_are_not_looked_at(self) -> None:
        data = patched(FILE, INDEX_TYPE, 4, "4s", b"HEAD")
        assert opened(data).recovered
        with pytest.raises(LimitError, match="GSVR_LIMIT_CHUNKS"):
            opened(data, Limits(chunks=3))

    def test_entries_that_do_not_match_their_chunks_are_refused_when_read(self) -> None:
        # A longer second GOP: exchanging the two lengths keeps their sum.
        payloads = [make_payload(4), make_payload(9, first_frame=3, start_pts=120)]
        good = make_file(payloads)
        data = patched(good, INDEX_TYPE, 8, "Q", len(payloads[1]))
        data = patched(data, INDEX_TYPE, 8 + 56, "Q", len(payloads[0]))
        reader = opened(data)
        for position in range(2):
            with pytest.raises(CorruptError, match=r"chunk|damaged"):
                reader.read_gop(position)

    @pytest.mark.parametrize("first_frame", [0, 2, 4, 2**62, 2**64 - 1])
    def test_frame_numbers_with_a_gap_are_not_believed(self, first_frame: int) -> None:
        data = patched(FILE, INDEX_TYPE, 4 + 56 + 12, "Q", first_frame)
        reader = opened(data)
        assert reader.recovered
        assert [gop.first_frame for gop in reader.gops] == [0, 3, 6]

    @pytest.mark.parametrize("kind", [b"HEAD", b"indx", b"fend", b"G\0PD", b"Nope"])
    def test_a_type_that_has_no_place_in_the_index(self, kind: bytes) -> None:
        data = patched(FILE, INDEX_TYPE, 4 + 3 * 56, "4s", kind)
        if kind == b"Nope":
            with pytest.raises(UnsupportedError, match="chunk Nope"):
                opened(data)
        else:
            assert opened(data).recovered
