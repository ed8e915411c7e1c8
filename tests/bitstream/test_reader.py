"""Writing files and reading them back."""

from __future__ import annotations

import io
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.bitstream.writer import GsvrWriter
from gsvrcodec.errors import CorruptError, GsvrError, InputError, LimitError
from gsvrcodec.limits import Limits
from tests.gops import HEADER, make_file, make_payload, make_payloads


def opened(data: bytes, limits: Limits | None = None) -> GsvrReader:
    return GsvrReader(io.BytesIO(data), limits or Limits())


class TestReader:
    def test_reads_what_was_written(self) -> None:
        payloads = make_payloads(4)
        with opened(make_file(payloads, auxiliary=((b"sett", b'{"seed": 1}'),))) as reader:
            assert [reader.read_gop(i) for i in range(4)] == payloads
            assert [gop.first_frame for gop in reader.gops] == [0, 3, 6, 9]
            assert [gop.start_pts for gop in reader.gops] == [0, 120, 240, 360]
            assert reader.gops[1].last_pts == 200
            assert reader.gops[1].last_duration == 40
            assert reader.frames == reader.header.frames == 12
            assert reader.header.gops == 4
            assert reader.header.max_gaussians == 5
            assert reader.header.max_gop_frames == 3
            assert reader.settings() == {"seed": 1}
            assert reader.auxiliary(b"meta") is None
            assert not reader.recovered
            assert reader.warnings == ()

    def test_lists_all_chunks_without_a_hole(self) -> None:
        data = make_file(make_payloads(2), auxiliary=((b"sett", b"{}"), (b"xabc", b"")))
        with opened(data) as reader:
            names = [chunk.name for chunk in reader.chunks]
            assert names == ["HEAD", "GOPD", "GOPD", "sett", "xabc", "indx", "fend"]
            ends = [8, *(chunk.end for chunk in reader.chunks)]
            assert [chunk.offset for chunk in reader.chunks] == ends[:-1]
            assert ends[-1] == len(data) == reader.size

    def test_settings_are_empty_without_their_chunk(self) -> None:
        assert opened(make_file(make_payloads(1))).settings() == {}

    def test_finds_the_gop_of_a_frame(self) -> None:
        reader = opened(make_file(make_payloads(3)))
        assert [reader.gop_of_frame(frame) for frame in range(9)] == [0, 0, 0, 1, 1, 1, 2, 2, 2]
        for frame in (-1, 9):
            with pytest.raises(IndexError):
                reader.gop_of_frame(frame)

    def test_threads_may_share_a_reader(self, tmp_path: Path) -> None:
        payloads = make_payloads(8)
        path = tmp_path / "a.gsvr"
        path.write_bytes(make_file(payloads))
        wanted = [n % 8 for n in range(400)]
        with GsvrReader(path) as reader, ThreadPoolExecutor(8) as pool:
            assert list(pool.map(reader.read_gop, wanted)) == [payloads[n] for n in wanted]

    def test_a_missing_file_fails(self, tmp_path: Path) -> None:
        with pytest.raises(InputError, match="no such file"):
            GsvrReader(tmp_path / "none.gsvr")

    def test_a_directory_fails(self, tmp_path: Path) -> None:
        with pytest.raises(InputError, match="is a directory"):
            GsvrReader(tmp_path)

    def test_a_file_that_shrinks_fails(self, tmp_path: Path) -> None:
        path = tmp_path / "a.gsvr"
        path.write_bytes(make_file(make_payloads(2)))
        with GsvrReader(path) as reader:
            path.write_bytes(path.read_bytes()[:200])
            with pytest.raises(InputError, match="became shorter"):
                reader.read_gop(1)

    def test_a_large_chunk_is_refused_when_it_is_read(self) -> None:
        reader = opened(make_file([make_payload(50)]), Limits(chunk_bytes=300))
        with pytest.raises(LimitError, match="GSVR_LIMIT_CHUNK_BYTES"):
            reader.read_gop(0)

    @pytest.mark.parametrize("text", [b"[]", b"{", b"\xff", b"[" * 100_000])
    def test_settings_that_are_no_json_object_fail(self, text: bytes) -> None:
        reader = opened(make_file(make_payloads(1), auxiliary=((b"sett", text),)))
        with pytest.raises(CorruptError, match="not a JSON object"):
            reader.settings()

    def test_large_settings_are_over_a_limit(self) -> None:
        reader = opened(make_file(make_payloads(1), auxiliary=((b"sett", b" " * 2**20 + b"{}"),)))
        with pytest.raises(LimitError, match="GSVR_LIMIT_METADATA_BYTES"):
            reader.settings()

    @settings(max_examples=300)
    @given(data=st.data())
    def test_mutated_files_raise_our_errors_alone(self, data: st.DataObject) -> None:
        mutated = bytearray(_SMALL)
        for _ in range(data.draw(st.integers(1, 4))):
            at = data.draw(st.integers(0, len(mutated) - 1))
            size = data.draw(st.integers(0, 12))
            mutated[at : at + size] = data.draw(st.binary(max_size=12))
            if not mutated:
                break
        try:
            with opened(bytes(mutated)) as reader:
                for position in range(len(reader.gops)):
                    payload = reader.read_gop(position)
                    assert payload in _SMALL_PAYLOADS
        except GsvrError:
            pass


_SMALL_PAYLOADS = make_payloads(3, gaussians=2)
_SMALL = make_file(_SMALL_PAYLOADS)


class TestWriter:
    def test_is_readable_after_every_gop(self) -> None:
        file = io.BytesIO()
        writer = GsvrWriter(file, HEADER)
        payloads = [
            make_payload(4 + n, frames=n + 1, first_frame=n * (n + 1) // 2, start_pts=1000 * n)
            for n in range(4)
        ]
        for count, payload in enumerate(payloads, 1):
            entry = writer.add_gop(payload)
            assert entry == writer.gops[-1]
            assert writer.size == len(file.getvalue())
            with opened(file.getvalue()) as reader:
                assert reader.recovered
                assert [reader.read_gop(n) for n in range(count)] == payloads[:count]
        writer.close()
        assert writer.header.frames == 10
        assert writer.size == len(file.getvalue())
        assert not opened(file.getvalue()).recovered

    def test_is_not_finished_after_an_error(self) -> None:
        file = io.BytesIO()
        with suppress(KeyError), GsvrWriter(file, HEADER) as writer:
            writer.add_gop(make_payload())
            raise KeyError
        assert opened(file.getvalue()).recovered

    def test_a_gop_out_of_order_fails(self) -> None:
        writer = GsvrWriter(io.BytesIO(), HEADER)
        first, second, third = make_payloads(3)
        writer.add_gop(first)
        with pytest.raises(ValueError, match="first frame is 6, expected 3"):
            writer.add_gop(third)
        with pytest.raises(ValueError, match="timestamp 80 does not come after 80"):
            writer.add_gop(make_payload(first_frame=3, start_pts=80))
        writer.add_gop(second)

    def test_something_else_than_a_gop_fails(self) -> None:
        with pytest.raises(ValueError, match="GOP of 3 bytes"):
            GsvrWriter(io.BytesIO(), HEADER).add_gop(b"abc")

    @pytest.mark.parametrize("kind", [b"GOPD", b"Abcd", b"indx", b"fend", b"abc", b"ab c"])
    def test_an_auxiliary_chunk_of_another_type_fails(self, kind: bytes) -> None:
        with pytest.raises(ValueError, match="type"):
            GsvrWriter(io.BytesIO(), HEADER).add_auxiliary(kind, b"")

    def test_no_gop_fails(self) -> None:
        with pytest.raises(ValueError, match="at least one GOP"):
            GsvrWriter(io.BytesIO(), HEADER).close()

    def test_closing_twice_does_nothing_and_adding_then_fails(self) -> None:
        file = io.BytesIO()
        writer = GsvrWriter(file, HEADER)
        writer.add_gop(make_payload())
        writer.close()
        data = file.getvalue()
        writer.close()
        with pytest.raises(ValueError, match="closed"):
            writer.add_auxiliary(b"sett", b"{}")
        assert file.getvalue() == data


def test_container_imports_the_standard_library_alone() -> None:
    code = (
        "import sys, gsvrcodec.bitstream.reader, gsvrcodec.bitstream.writer;"
        "print([m for m in ('numpy', 'torch', 'av', 'cv2', 'imagecodecs') if m in sys.modules])"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"
