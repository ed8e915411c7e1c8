"""The state of an encode that can be resumed: kept, found again, never believed blindly."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from gsvrcodec.encoder.analysis import Analysis, FrameStats
from gsvrcodec.encoder.checkpoint import Checkpoint
from gsvrcodec.encoder.results import EncodedGop
from gsvrcodec.errors import OutputError
from tests.cli.tools import ROOT

PLAN: dict[str, Any] = {"version": "1", "settings": {"seed": 0, "crop": (1, 2), "gop_min": 12}}
FIRST, SECOND = range(0, 3), range(3, 9)
FIGURES = EncodedGop(frames=FIRST, psnr=0.1 + 0.2, float_psnr=99.0, seconds=float("inf"))
OTHERS = EncodedGop(frames=SECOND, psnr=30.0, float_psnr=30.5, seconds=1.0)
ANALYSIS = Analysis((FrameStats(1.5, True),), (0,), (40,), (2**32 - 1,))


def opened(
    target: Path | None, *, resume: bool = True, restart: bool = False, **plan: Any
) -> Checkpoint:
    return Checkpoint(target, {**PLAN, **plan}, resume=resume, restart=restart)


def done(gop: range, figures: EncodedGop, payload: bytes) -> EncodedGop:
    return replace(figures, frames=gop, payload=payload)


def failed(parts: Checkpoint) -> list[str]:
    """Leave the block of an encode by an error; return the notes that the error got."""
    error = KeyboardInterrupt()
    parts.__exit__(type(error), error, None)
    return getattr(error, "__notes__", [])


def interrupted(target: Path) -> Path:
    """Keep two GOPs and be interrupted; return the file."""
    parts = opened(target)
    parts.keep_analysis(ANALYSIS)
    parts.add(done(FIRST, FIGURES, b"first"))
    parts.add(done(SECOND, OTHERS, b""))
    failed(parts)
    return target.with_name(target.name + ".part")


@pytest.fixture
def target(tmp_path: Path) -> Path:
    return tmp_path / "out.gsvr"


class TestResume:
    def test_a_job_s_result_comes_back(self, target: Path) -> None:
        first = replace(FIGURES, qscale=0.1 + 0.2, plate_bytes=3, payload=b"first")
        second = replace(OTHERS, payload=b"second")
        with opened(target) as parts:
            parts.add(first)
            parts.add(second)
            assert parts.result(FIRST) == first
            assert parts.result(SECOND) == second

    def test_success_leaves_nothing(self, target: Path) -> None:
        with opened(target) as parts:
            assert parts.path is not None
            parts.add(done(FIRST, OTHERS, b"x"))
            assert parts.path.exists()
        assert not list(target.parent.iterdir())

    def test_failure_before_the_first_gop_leaves_nothing(self, target: Path) -> None:
        parts = opened(target)
        parts.keep_analysis(ANALYSIS)
        assert failed(parts) == []
        assert not list(target.parent.iterdir())

    def test_a_link_keeps_its_parts_beside_what_it_points_to(self, target: Path) -> None:
        (target.parent / "real").mkdir()
        target.symlink_to(target.parent / "real" / "a.gsvr")
        with opened(target) as parts:
            assert parts.path == target.parent / "real" / "a.gsvr.part"

    def test_nothing_is_kept_where_there_is_no_place(self) -> None:
        with opened(None) as parts:
            parts.add(done(FIRST, FIGURES, b"first"))
            assert parts.path is None
            assert parts.payload(FIRST) == b"first"


class TestRefused:
    def test_without_being_asked(self, target: Path) -> None:
        path = interrupted(target)
        before = path.read_bytes()
        with pytest.raises(OutputError, match=r"2 finished .* `resume=True` .* `overwrite=True`"):
            opened(target, resume=False)
        assert path.read_bytes() == before

    def test_overwriting_starts_anew(self, target: Path) -> None:
        interrupted(target)
        with opened(target, resume=False, restart=True) as parts:
            assert len(parts) == 0
            assert parts.analysis is None

    def test_resuming_is_stronger_than_overwriting(self, target: Path) -> None:
        interrupted(target)
        with opened(target, resume=True, restart=True) as parts:
            assert len(parts) == 2

    @pytest.mark.parametrize(
        ("changed", "message"),
        [
            ({"version": "2"}, "begun with version 1, not 2;"),
            ({"settings": {"seed": 1, "crop": (1, 2), "gop_min": 12}}, "with `seed` 0, not 1;"),
            (
                {"settings": {"seed": 0, "crop": None, "gop_min": 13}},
                r"with `crop` \[1, 2\], not None, `gop_min` 12, not 13;",
            ),
            ({"new": 3}, "with new None, not 3;"),
        ],
    )
    def test_with_another_plan(self, target: Path, changed: dict[str, Any], message: str) -> None:
        path = interrupted(target)
        before = path.read_bytes()
        with pytest.raises(OutputError, match=message):
            opened(target, **changed)
        assert path.read_bytes() == before

    def test_another_plan_is_no_matter_where_no_gop_is_finished(self, target: Path) -> None:
        opened(target)._file.close()  # as a kill leaves it
        with opened(target, version="2") as parts:
            parts.add(done(FIRST, OTHERS, b"x"))

    def test_a_file_of_somebody_else(self, target: Path) -> None:
        path = target.with_name("out.gsvr.part")
        path.write_bytes(b"half a download")
        for restart in (False, True):
            with pytest.raises(OutputError, match="is in the way"):
                opened(target, resume=not restart, restart=restart)
        assert path.read_bytes() == b"half a download"

    def test_while_another_process_has_it(self, target: Path) -> None:
        code = f"""
import sys
from pathlib import Path
from gsvrcodec.encoder.analysis import Analysis, FrameStats
from gsvrcodec.encoder.checkpoint import Checkpoint
from gsvrcodec.encoder.results import EncodedGop
with Checkpoint(Path({str(target)!r}), {{}}, resume=False, restart=False):
    print("ready", flush=True)
    sys.stdin.read()
"""
        process = subprocess.Popen(
            [sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=ROOT
        )
        assert process.stdin is not None
        assert process.stdout is not None
        with process:
            assert process.stdout.readline() == b"ready\n"
            with pytest.raises(OutputError, match=r"out\.gsvr\.part is in use"):
                opened(target, restart=True)
            process.kill()
        with opened(target):
            pass


class TestDamage:
    def test_every_cut_keeps_the_whole_parts_before_it(self, target: Path) -> None:
        path = interrupted(target)
        data = path.read_bytes()
        found = []
        for size in range(len(data)):
            path.write_bytes(data[:size])
            parts = opened(target)
            found.append(len(parts))
            if FIRST in parts:
                assert parts.payload(FIRST) == b"first"
            # Going on leaves a sound file, whatever the cut.
            parts.add(done(FIRST, OTHERS, b"again"))
            parts._file.close()
            with opened(target) as parts:
                assert parts.payload(FIRST) == b"again"
        assert set(found) == {0, 1}
        assert found == sorted(found)

    def test_every_flip_is_noticed(self, target: Path) -> None:
        path = interrupted(target)
        data = path.read_bytes()
        refused = 0
        for offset in range(len(data)):
            damaged = bytearray(data)
            damaged[offset] ^= 1 << offset % 8
            path.write_bytes(damaged)
            try:
                parts = opened(target)
            except OutputError:
                refused += 1
                continue
            if FIRST in parts:
                assert (parts.figures(FIRST), parts.payload(FIRST)) == (FIGURES, b"first")
            if SECOND in parts:
                assert (parts.figures(SECOND), parts.payload(SECOND)) == (OTHERS, b"")
            assert len(parts) < 2 or parts.analysis is None
            parts._file.close()
        assert 0 < refused < len(data)

    def test_a_part_that_changes_while_it_is_used_fails(self, target: Path) -> None:
        path = interrupted(target)
        with opened(target) as parts:
            data = path.read_bytes()
            path.write_bytes(data.replace(b"first", b"worst"))
            with pytest.raises(OutputError, match="is not what was written"):
                parts.payload(FIRST)
