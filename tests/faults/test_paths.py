"""Faults 19 and 24: places that cannot be written, inputs that change, names that are awkward."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import gsvrcodec
from gsvrcodec.encoder.progress import Progress
from gsvrcodec.errors import InputError
from tests import making
from tests.cli.tools import Runner, start

SMALL = (
    *("--frames", "4", "--gop", "2", "--gaussians", "50"),
    *("--preset", "fastest", "--pack", "deflate"),
)
FULL = Path("/dev/full")

needs_full = pytest.mark.skipif(not FULL.exists(), reason="needs /dev/full")


@pytest.fixture
def cli(capsys: pytest.CaptureFixture[str]) -> Runner:
    return Runner(capsys)


@pytest.fixture
def read_only(tmp_path: Path) -> Iterator[Path]:
    """A directory that nobody can write, not even root."""
    if os.geteuid() == 0:
        yield Path("/sys")
        return
    directory = tmp_path / "read-only"
    directory.mkdir()
    directory.chmod(0o555)
    yield directory
    directory.chmod(0o755)


class TestWriting:
    """Fault 19: exit code 1, and nothing is lost."""

    @needs_full
    def test_a_full_disk(self, cli: Runner, tmp_path: Path) -> None:
        coded = making.gsvr_file(tmp_path / "a.gsvr")
        calls: list[tuple[str | Path, ...]] = [
            ("gsvrenc", making.NOISE, FULL, *SMALL, "-q"),
            ("gsvrdec", coded, FULL, "--muxer", "y4m", "-q"),
            ("gsvrinfo", coded, "--json", FULL),
        ]
        for call in calls:
            result = cli(*map(str, call))
            assert result.code == 1, result
            assert "no space left on device" in result.err.lower()
            assert "Traceback" not in result.err
        assert [path.name for path in tmp_path.iterdir()] == ["a.gsvr"]

    @needs_full
    def test_a_full_standard_output(self, tmp_path: Path) -> None:
        coded = making.gsvr_file(tmp_path / "a.gsvr")
        with FULL.open("wb") as full:
            for call in (
                ("gsvrenc", making.NOISE, "-", "-q", *SMALL),
                ("gsvrdec", coded, "-", "-q"),
                ("gsvrinfo", coded),
            ):
                process = start(*call, stdout=full, stderr=subprocess.PIPE)
                err = process.communicate(timeout=60)[1].decode()
                assert process.returncode == 1
                assert "no space left on device" in err.lower()
                assert "Traceback" not in err

    def test_a_read_only_directory(self, cli: Runner, tmp_path: Path, read_only: Path) -> None:
        coded = making.gsvr_file(tmp_path / "a.gsvr")
        for call in (
            ("gsvrenc", making.NOISE, read_only / "b.gsvr", *SMALL),
            ("gsvrdec", coded, read_only / "b.y4m", "-q"),
            ("gsvrdec", coded, read_only / "%d.png", "-q"),
        ):
            assert f"{read_only}" in cli.fails(1, *call)

    def test_the_output_is_a_directory(self, cli: Runner, tmp_path: Path) -> None:
        coded = making.gsvr_file(tmp_path / "a.gsvr")
        (tmp_path / "b.gsvr").mkdir()
        for call in (("gsvrenc", making.NOISE), ("gsvrdec", coded, "--muxer", "mp4")):
            for options in ((), ("-y",)):
                line = cli.fails(1, *call, tmp_path / "b.gsvr", *options)
                assert "b.gsvr is a directory" in line

    def test_the_output_is_the_input_through_a_link(self, cli: Runner, tmp_path: Path) -> None:
        source, coded = tmp_path / "a.mp4", making.gsvr_file(tmp_path / "a.gsvr")
        source.write_bytes(making.NOISE.read_bytes())
        before = source.read_bytes(), coded.read_bytes()
        for name, original in (("gsvrenc", source), ("gsvrdec", coded)):
            hard, soft = tmp_path / f"{name}-hard.mp4", tmp_path / f"{name}-soft.mp4"
            hard.hardlink_to(original)
            soft.symlink_to(original)
            for target in (original, hard, soft):
                options = ("--muxer", "mp4") if name == "gsvrdec" else ()
                line = cli.fails(1, name, original, target, "-y", *options)
                assert "is the input itself" in line
        assert (source.read_bytes(), coded.read_bytes()) == before

    def test_a_source_that_shrinks_while_it_is_read(self, tmp_path: Path) -> None:
        pictures = list(np.random.default_rng(0).integers(0, 256, (8, 32, 32, 3), np.uint8))
        source = making.write_video(tmp_path / "a.y4m", pictures)

        def shrink(state: Progress) -> None:
            if state.gop == 0:
                os.truncate(source, source.stat().st_size // 2)

        with pytest.raises(InputError, match=r"a\.y4m became shorter while it was read"):
            gsvrcodec.encode(
                source, tmp_path / "a.gsvr", preset="fastest", gop=4, progress=shrink, workers=1
            )
        assert not (tmp_path / "a.gsvr").exists()


class TestNames:
    """Fault 24."""

    @pytest.mark.parametrize("stem", ["-dash", "ünï 視頻 x'y\"z", "100%:b"])
    def test_any_name(
        self, cli: Runner, tmp_path: Path, stem: str, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.chdir(tmp_path)
        Path(f"{stem}.mp4").write_bytes(making.NOISE.read_bytes())
        names = [f"{stem}.mp4", f"{stem}.gsvr", f"{stem} again.mkv"]
        for name, args in (
            ("gsvrenc", [*SMALL, "--", *names[:2]]),
            ("gsvrdec", ["--", *names[1:]]),
            ("gsvrinfo", ["--", names[1]]),
            ("gsvrreport", ["--", *names[:2]]),
        ):
            result = cli(name, *args)
            assert result.code == 0, result.err
        assert {path.name for path in tmp_path.iterdir()} == set(names)

    def test_a_pipe_closed_early(self, tmp_path: Path) -> None:
        process = start(
            *("gsvrenc", making.NOISE, "-", "-q", *SMALL, "--gaussians", "4k"),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            environment={"TMPDIR": str(tmp_path)},
        )
        assert process.stdout is not None
        process.stdout.close()
        assert process.stderr is not None
        assert process.stderr.read() == b""
        process.stderr.close()
        assert process.wait(timeout=60) == 1
        assert not list(tmp_path.iterdir())
