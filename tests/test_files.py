"""Fingerprints of inputs, what killed programs leave, and outputs that are no files."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from gsvrcodec.errors import OutputError
from gsvrcodec.files import (
    atomic_output,
    fingerprint,
    gathered_output,
    is_stream,
    lock,
    remove_partials,
)

MIB = 2**20


class TestFingerprint:
    def test_tells_a_changed_file(self, tmp_path: Path) -> None:
        path = tmp_path / "a"
        seen = []
        for data, time in [
            (b"", 0),
            (b"ab", 0),
            (b"ac", 0),
            (b"ab", 1),
            (bytes(3 * MIB), 0),
            (bytes(3 * MIB - 1) + b"\1", 0),
        ]:
            path.write_bytes(data)
            os.utime(path, ns=(0, time))
            seen.append(fingerprint(path))
        assert all(seen[i] != seen[j] for i in range(len(seen)) for j in range(i))
        assert fingerprint(path) == seen[-1]

    def test_does_not_depend_on_the_name(self, tmp_path: Path) -> None:
        (tmp_path / "a").write_bytes(b"x")
        before = fingerprint(tmp_path / "a")
        (tmp_path / "a").rename(tmp_path / "b")
        assert fingerprint(tmp_path / "b") == before

    def test_of_numbered_pictures(self, tmp_path: Path) -> None:
        name = tmp_path / "p_%03d.png"
        assert fingerprint(name) == {}
        for number in range(3):
            (tmp_path / f"p_{number:03}.png").write_bytes(b"x")
        (tmp_path / "p_a.png").write_bytes(b"x")
        before = fingerprint(name)
        assert before["input_files"] == before["input_bytes"] == 3
        (tmp_path / "p_003.png").write_bytes(b"x")
        assert fingerprint(name) != before

    def test_what_is_read_only_once_has_none(self, tmp_path: Path) -> None:
        os.mkfifo(tmp_path / "pipe")
        for path in ("-", tmp_path / "pipe", tmp_path / "none", tmp_path):
            assert fingerprint(path) == {}


def test_streams(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "file").touch()
    for stream in ("-", tmp_path / "pipe", os.devnull):
        assert is_stream(stream)
    for other in (tmp_path / "file", tmp_path, tmp_path / "none"):
        assert not is_stream(other)


def test_partials_of_the_dead_are_removed(tmp_path: Path) -> None:
    mine, others = ".a.0123abcd.part", ["a", "a.part", ".b.0123abcd.part", ".a.xyz.part"]
    for name in (mine, *others):
        (tmp_path / name).touch()
    remove_partials(tmp_path / "a")
    assert {path.name for path in tmp_path.iterdir()} == set(others)
    with atomic_output(tmp_path / "c") as partial:
        remove_partials(tmp_path / "c")
        assert not partial.exists()
        partial.touch()


class TestGathered:
    def test_to_the_standard_output(self, capfdbinary: pytest.CaptureFixture[bytes]) -> None:
        with gathered_output("-") as path:
            path.write_bytes(b"all of it")
        assert capfdbinary.readouterr().out == b"all of it"

    def test_a_failure_writes_nothing(self, capfdbinary: pytest.CaptureFixture[bytes]) -> None:
        def fail(path: Path) -> None:
            path.write_bytes(b"half")
            raise ValueError("why")

        with pytest.raises(ValueError, match="why"), gathered_output("-") as path:
            fail(path)
        assert capfdbinary.readouterr().out == b""


def test_a_lock_is_held_until_the_file_is_closed(tmp_path: Path) -> None:
    with lock(tmp_path / "a"), pytest.raises(OutputError, match="in use by another process"):
        lock(tmp_path / "a")
    lock(tmp_path / "a").close()
