"""Faults 20 and 21: encodes that are killed, interrupted, started twice or resumed wrongly."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

import gsvrcodec
from gsvrcodec.encoder.progress import Progress
from tests import making
from tests.cli.tools import ROOT, Runner, start
from tests.faults.kills import children, gone, kill_and_resume

SMALL = (
    *("--frames", "6", "--gop", "2", "--gaussians", "50"),
    *("--preset", "fastest", "--pack", "deflate"),
)

pytestmark = pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="needs Linux")


@pytest.fixture
def cli(capsys: pytest.CaptureFixture[str]) -> Runner:
    return Runner(capsys)


def slow_encode(target: Path, *options: str) -> subprocess.Popen[bytes]:
    """Start an encode of four chains of three GOPs, and wait for its first GOP."""
    options = ("--gop", "2", "--keyint", "0.4", "--gaussians", "300", *options)
    options = ("--preset", "slow", *options)
    pipes: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    process = start("gsvrenc", making.NOISE, target, "--progress", "json", *options, **pipes)
    assert process.stdout is not None
    for line in process.stdout:
        if json.loads(line)["gop"]:
            return process
    pytest.fail(process.communicate()[1].decode())


class TestKill:
    """Fault 20."""

    @pytest.mark.slow
    def test_resumed_after_kills_gives_the_same_bytes(self, tmp_path: Path) -> None:
        kept = kill_and_resume(tmp_path, 3, often=3)
        assert len(kept) == 3
        assert any(kept)

    def test_once_says_how_to_resume(self, tmp_path: Path) -> None:
        target = tmp_path / "a b.gsvr"
        process = slow_encode(target, "--workers", "2")
        started = children(process)
        process.send_signal(signal.SIGINT)
        err = process.communicate(timeout=20)[1].decode()
        assert process.returncode == 130
        assert re.fullmatch(
            r"gsvrenc: error: interrupted; \d finished GOPs? (is|are) kept in "
            rf"{re.escape(str(target))}\.part, --resume goes on from there",
            err.strip(),
        )
        assert [path.name for path in tmp_path.iterdir()] == ["a b.gsvr.part"]
        assert started
        assert all(map(gone, started))

    def test_twice_ends_at_once(self) -> None:
        code = """
import click, time
from gsvrcodec.cli.common import run

@click.command("gsvrtest")
def command():
    try:
        print("ready", flush=True)
        time.sleep(60)
    finally:
        print("first", flush=True)
        time.sleep(60)

run(command, [])
"""
        process = subprocess.Popen(
            [sys.executable, "-c", code], stdout=subprocess.PIPE, cwd=ROOT, text=True
        )
        assert process.stdout is not None
        with process:
            for word in ("ready", "first"):
                assert process.stdout.readline() == f"{word}\n"
                process.send_signal(signal.SIGINT)
            began = time.monotonic()
            assert process.wait(timeout=20) == 130
            assert time.monotonic() - began < 10

    def test_two_encoders_on_one_output(self, cli: Runner, tmp_path: Path) -> None:
        target = tmp_path / "a.gsvr"
        process = slow_encode(target, "--workers", "1")
        for options in ((), ("-y",), ("--resume",)):
            line = cli.fails(1, "gsvrenc", making.NOISE, target, *SMALL, *options)
            assert f"{target}.part is in use by another process" in line
        process.kill()
        process.communicate()
        assert cli("gsvrenc", making.NOISE, target, *SMALL, "-y").code == 0


class TestState:
    """Fault 21."""

    @pytest.fixture
    def target(self, tmp_path: Path) -> Path:
        """An output of which the first two of three GOPs are finished."""
        target = tmp_path / "a.gsvr"

        def stop(state: Progress) -> None:
            if state.gop == 2:
                raise KeyboardInterrupt

        settings: dict[str, Any] = {"frames": 6, "gop": 2, "gaussians": 50}
        settings |= {"preset": "fastest", "pack": "deflate"}
        with pytest.raises(KeyboardInterrupt):
            gsvrcodec.encode(making.NOISE, target, progress=stop, **settings)
        return target

    def resumed(self, cli: Runner, target: Path) -> bytes:
        assert cli("gsvrenc", making.NOISE, target, *SMALL, "--resume", "-y").code == 0
        return target.read_bytes()

    @pytest.mark.parametrize(
        ("options", "difference"),
        [
            (["--seed", "1"], "--seed 0, not 1"),
            (["--gaussians", "51"], "--gaussians 50, not 51"),
            (["--no-audio"], "--audio True, not False"),
            (["--crop", "64:64"], "--crop None, not [64, 64, None, None]"),
        ],
        ids=lambda value: value[0] if isinstance(value, list) else None,
    )
    def test_another_setting(
        self, cli: Runner, target: Path, options: list[str], difference: str
    ) -> None:
        line = cli.fails(1, "gsvrenc", making.NOISE, target, *SMALL, *options, "--resume")
        assert f"cannot be resumed: it was begun with {difference};" in line

    def test_another_version(
        self, cli: Runner, target: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr("gsvrcodec.versions.__version__", "99.0")
        line = cli.fails(1, "gsvrenc", making.NOISE, target, *SMALL, "--resume")
        assert f"begun with gsvrcodec {gsvrcodec.__version__}, not 99.0;" in line

    def test_another_input(self, cli: Runner, target: Path) -> None:
        line = cli.fails(1, "gsvrenc", making.BUNNY_SMALL, target, *SMALL, "--resume")
        assert "begun with input-bytes " in line

    def test_garbage_at_its_end_is_ignored(self, cli: Runner, target: Path) -> None:
        state = target.with_name("a.gsvr.part")
        sound = state.read_bytes()
        whole = self.resumed(cli, target)
        for garbage in (b"\0" * 500, b"part" * 99, bytes(range(256))):
            state.write_bytes(sound + garbage)
            assert self.resumed(cli, target) == whole

    def test_damage_in_a_part_is_done_again(self, cli: Runner, target: Path) -> None:
        state = target.with_name("a.gsvr.part")
        sound = state.read_bytes()
        whole = self.resumed(cli, target)
        for offset in (len(sound) - 40, sound.index(b"part") + 30, sound.index(b"stat") + 30):
            damaged = bytearray(sound)
            damaged[offset] ^= 4
            state.write_bytes(damaged)
            assert self.resumed(cli, target) == whole

    def test_damage_at_its_start_is_refused(self, cli: Runner, target: Path) -> None:
        state = target.with_name("a.gsvr.part")
        damaged = bytearray(state.read_bytes())
        damaged[40] ^= 4
        state.write_bytes(damaged)
        line = cli.fails(1, "gsvrenc", making.NOISE, target, *SMALL, "--resume")
        assert "is damaged and cannot be resumed; -y alone starts anew" in line
        assert state.read_bytes() == damaged
