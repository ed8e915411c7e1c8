"""What holds for all commands."""

from __future__ import annotations

import json
import logging
import os
import re
import select
import signal
import subprocess
import sys
import time
from contextlib import suppress
from importlib import metadata
from pathlib import Path

import click
import pytest

import gsvrcodec
from gsvrcodec.cli import dec, enc, info, play, report, values
from gsvrcodec.cli.common import as_options, run
from gsvrcodec.cli.progress import EncodeDisplay, EncodeJson, clock, fitted
from gsvrcodec.encoder.encode import Progress
from gsvrcodec.errors import UsageError
from tests import making
from tests.cli.tools import MAINS, ROOT, Runner, start

COMMANDS = {
    "gsvrenc": enc.command,
    "gsvrdec": dec.command,
    "gsvrinfo": info.command,
    "gsvrreport": report.command,
    "gsvrplay": play.command,
}
HEAVY = {"torch", "cv2", "matplotlib", "rich"}


@pytest.fixture
def cli(capsys: pytest.CaptureFixture[str]) -> Runner:
    return Runner(capsys)


@pytest.mark.parametrize("name", MAINS)
class TestAll:
    def test_version(self, cli: Runner, name: str) -> None:
        result = cli(name, "--version")
        assert result.code == 0
        lines = dict(re.split(r" {2,}|(?<=core) ", line) for line in result.out.splitlines())
        assert lines["gsvrcodec"] == gsvrcodec.__version__
        assert re.fullmatch(r"\d+\.\d+", lines["bitstream"])
        assert lines["native core"] in ("avx512", "avx2", "portable")
        assert lines["torch"] == metadata.version("torch")
        assert re.match(r"\d+\.\d+", lines["FFmpeg"])

    @pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
    def test_completion_of_the_shell(self, name: str, shell: str) -> None:
        variable = f"_{name.upper()}_COMPLETE"
        process = start(name, stdout=subprocess.PIPE, environment={variable: f"{shell}_source"})
        script = process.communicate(timeout=60)[0].decode()
        assert process.returncode == 0
        assert variable in script

    def test_completion_knows_the_options(self, name: str) -> None:
        words = {"COMP_WORDS": f"{name} --ver", "COMP_CWORD": "1"}
        environment = {f"_{name.upper()}_COMPLETE": "bash_complete", **words}
        process = start(name, stdout=subprocess.PIPE, environment=environment)
        assert b"plain,--version\n" in process.communicate(timeout=60)[0]

    def test_help_has_an_example(self, cli: Runner, name: str) -> None:
        result = cli(name, "--help")
        assert result.code == 0
        assert f"\n  {name} " in result.out
        assert all(len(line) <= 80 for line in result.out.splitlines())

    def test_the_page_has_every_option(self, name: str) -> None:
        page = (ROOT / "spec" / "cli.md").read_text("utf-8")
        (section,) = re.findall(rf"^## {name}$(.*?)(?=^## |\Z)", page, re.MULTILINE | re.DOTALL)
        described = set(re.findall(r"`(-[\w-]+)", section)) | {"--version", "--help"}
        known = {
            spelling
            for option in COMMANDS[name].params
            if isinstance(option, click.Option)
            for spelling in (*option.opts, *option.secondary_opts)
        }
        assert described >= known
        assert described - known <= {"--help", "-", "--", "-a.gsvr"}

    def test_no_arguments_fails(self, cli: Runner, name: str) -> None:
        assert f"usage: {name} " in cli.fails(2, name)

    @pytest.mark.parametrize("args", [["-i", "a", "b"], ["a", "-o", "b"]])
    def test_files_have_no_options(self, cli: Runner, name: str, args: list[str]) -> None:
        assert f"{name} [OPTIONS]".split()[0] in cli.fails(2, name, *args)

    def test_unknown_option_fails(self, cli: Runner, name: str) -> None:
        assert "No such option" in cli.fails(2, name, "--fastt", "a", "b")

    def test_missing_input_fails(self, cli: Runner, name: str, tmp_path: Path) -> None:
        args = [tmp_path / "none"] + [tmp_path / "out.mp4"] * (name not in ("gsvrinfo", "gsvrplay"))
        assert str(tmp_path / "none") in cli.fails(1, name, *args)
        assert not list(tmp_path.iterdir())

    def test_help_is_light(self, name: str) -> None:
        code = f"""
import sys
sys.argv = ["x", "--help"]
from gsvrcodec.cli.{name.removeprefix("gsvr")} import main
main()
print(*{{name.partition(".")[0] for name in sys.modules}})
"""
        printed = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT
        ).stdout
        assert HEAVY.isdisjoint(printed.splitlines()[-1].split())


class TestFailures:
    def test_notes_are_told(self, capsys: pytest.CaptureFixture[str]) -> None:
        @click.command("gsvrtest")
        def command() -> None:
            error = KeyboardInterrupt()
            error.add_note("go on so")
            raise error

        assert run(command, []) == 130
        assert capsys.readouterr().err.strip() == "gsvrtest: error: interrupted; go on so"

    @pytest.mark.parametrize(
        ("error", "code", "message"),
        [
            (KeyboardInterrupt(), 130, "interrupted"),
            (MemoryError(), 1, "out of memory"),
            (OSError(5, "Input/output error"), 1, "Input/output error"),
            (ZeroDivisionError("by zero\nline"), 1, "ZeroDivisionError: by zero (set GSVR_DEBUG"),
        ],
    )
    def test_one_line(
        self, capsys: pytest.CaptureFixture[str], error: BaseException, code: int, message: str
    ) -> None:
        @click.command("gsvrtest")
        def command() -> None:
            raise error

        assert run(command, []) == code
        (line,) = capsys.readouterr().err.splitlines()[-1:]
        assert line.startswith("gsvrtest: error: ")
        assert message in line

    def test_debugging_shows_where(self, monkeypatch: pytest.MonkeyPatch) -> None:
        @click.command("gsvrtest")
        def command() -> None:
            raise ZeroDivisionError

        monkeypatch.setenv("GSVR_DEBUG", "1")
        with pytest.raises(ZeroDivisionError):
            run(command, [])

    def test_interrupt_leaves_nothing(self, tmp_path: Path) -> None:
        path = making.gsvr_file(tmp_path / "a.gsvr", frames=[1000] * 3)
        target = tmp_path / "out.y4m"
        process = start("gsvrdec", path, target, stderr=subprocess.PIPE)
        deadline = time.monotonic() + 20
        while not any(p.stat().st_size > 10**5 for p in tmp_path.glob(".*")):
            assert time.monotonic() < deadline
            time.sleep(0.005)
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=20)
        assert process.returncode == 130
        assert err.strip() == b"gsvrdec: error: interrupted"
        assert [p.name for p in tmp_path.iterdir()] == ["a.gsvr"]

    def test_pipe_closed_early(self, tmp_path: Path) -> None:
        path = making.gsvr_file(tmp_path / "a.gsvr", frames=[320])
        process = start("gsvrdec", path, "-", stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        assert process.stdout is not None
        assert process.stdout.read(9) == b"YUV4MPEG2"
        process.stdout.close()
        assert process.stderr is not None
        assert process.stderr.read() == b""
        assert process.wait(timeout=20) == 1
        process.stderr.close()


class TestArguments:
    """The library speaks of arguments, and the commands of their options."""

    @pytest.mark.parametrize(
        ("message", "printed"),
        [
            ("`target_psnr` must be above 0 dB", "--target-psnr must be above 0 dB"),
            ("`bpp=1e-05` leaves 0 bytes", "--bpp 1e-05 leaves 0 bytes"),
            ("`gop_min=9` and `gop_max=8`: no", "--gop-min 9 and --gop-max 8: no"),
            ("`stop_seconds=1` is not after `start_seconds=2`", "--to 1 is not after --ss 2"),
            ("or choose `device='cpu'`", "or choose --device cpu"),
            ("(`resume=True` goes on, `overwrite=True` not)", "(--resume goes on, -y not)"),
            ("`audio=False`; `audio=True`, `audio`", "--no-audio; --audio, --audio"),
            ("`quiet`", "--quiet"),
        ],
    )
    def test_become_options(self, message: str, printed: str) -> None:
        assert as_options(message, enc.command.params) == printed

    @pytest.mark.parametrize(
        "message",
        [
            "`keep_going=True` decodes them",  # of another command
            "`source` and `target`",  # no options
            "`deinterlace=False`",  # needs no option
            "bpp=1 without backticks",
            "`bpp` 2`, ``bpp``, `bpp",
            "/a/`seed` and `seed`.mp4 and `seed`/b do not exist",
            "`seed and frames`",
        ],
    )
    def test_others_stay(self, message: str) -> None:
        expected = message.replace("`bpp` 2`", "--bpp 2`")
        assert as_options(message, enc.command.params) == expected

    def test_in_errors_notes_and_warnings(self, capsys: pytest.CaptureFixture[str]) -> None:
        @click.command("gsvrtest")
        @click.option("--ss", "start_seconds")
        def command(start_seconds: str | None) -> None:
            logging.getLogger("gsvrcodec.any").warning("%s is early", "`start_seconds=1`")
            error = UsageError("`start_seconds` is late")
            error.add_note("`start_seconds=2` is right")
            raise error

        assert run(command, []) == 2
        assert capsys.readouterr().err.splitlines() == [
            "gsvrtest: warning: --ss 1 is early",
            "gsvrtest: error: --ss is late; --ss 2 is right",
        ]


class TestValues:
    @pytest.mark.parametrize(
        ("text", "number"),
        [("7", 7), ("250k", 250_000), ("3M", 3_000_000), ("1.5m", 1_500_000), ("2G", 2 * 10**9)],
    )
    def test_count(self, text: str, number: int) -> None:
        assert values.count(text) == number

    @pytest.mark.parametrize("text", ["", "k", "3T", "1.5", "1.0001k", "nanM", "infM", "1e999M"])
    def test_count_fails(self, text: str) -> None:
        with pytest.raises(click.BadParameter, match="not a whole number"):
            values.count(text)

    def test_crop(self) -> None:
        assert values.crop("1280:640") == (1280, 640, None, None)
        assert values.crop("12:6:0:40") == (12, 6, 0, 40)

    @pytest.mark.parametrize("text", ["", "12", "1:2:3", "1:2:3:4:5", "a:b", "-1:2", "1x2"])
    def test_crop_fails(self, text: str) -> None:
        with pytest.raises(click.BadParameter, match="not W:H"):
            values.crop(text)

    def test_gop_length(self) -> None:
        assert values.gop_length("adaptive") == "adaptive"
        assert values.gop_length("24") == 24
        with pytest.raises(click.BadParameter):
            values.gop_length("-4")

    @pytest.mark.parametrize(
        ("text", "number"),
        [
            ("7", 7),
            ("700k", 700_000),
            ("10MB", 10**7),
            ("1.5m", 1_500_000),
            ("1.5MiB", 1_572_864),
            ("2G", 2 * 10**9),
            ("12b", 12),
        ],
    )
    def test_file_size(self, text: str, number: int) -> None:
        assert values.file_size(text) == number

    @pytest.mark.parametrize("text", ["", "MB", "-1", "1e3", "10TB", "10Mi", "1.M", "1 MB", "nan"])
    def test_file_size_fails(self, text: str) -> None:
        with pytest.raises(click.BadParameter, match="not a size"):
            values.file_size(text)


class TestProgress:
    def test_plain_lines(self, capsys: pytest.CaptureFixture[str]) -> None:
        with EncodeDisplay() as display:
            display(Progress(0, 6, 0, 132, None, None, None))
            display(Progress(0, 6, 0, 132, None, None, None))  # says nothing new
            display(Progress(2, 6, 48, 132, 36.208, 1.07, 89.9, bitrate=412345.0))
            display(Progress(6, 6, 132, 132, 36.208, 1.07, 0.0, phase="verifying"))
        assert capsys.readouterr().err.splitlines() == [
            "GOP 0/6  0/132 frames",
            "GOP 2/6  48/132 frames  36.21 dB  412.3 kbit/s  1.07 s/frame  ETA 1:30",
            "verifying",
        ]

    def test_before_the_fits(self, capsys: pytest.CaptureFixture[str]) -> None:
        with EncodeDisplay() as display:
            display(Progress(0, 0, 0, 96, None, None, 61.0, phase="analysing"))
        (line,) = capsys.readouterr().err.splitlines()
        assert line == "analysing  0/96 frames  ETA about 1:01"

    def test_a_first_pass(self, capsys: pytest.CaptureFixture[str]) -> None:
        with EncodeDisplay() as display:
            display(Progress(2, 6, 48, 132, 36.208, 0.2, None, phase="measuring"))
        (line,) = capsys.readouterr().err.splitlines()
        assert line == "GOP 2/6  48/132 frames of a first pass  36.21 dB  0.20 s/frame"

    def test_fits_a_terminal(self) -> None:
        parts = ["1/3 chains, 2 workers", "GOP 12/34", "123/456 frames", "38.21 dB", "ETA 1:02:03"]
        assert fitted(parts, 120) == ("  ".join(parts), 24)
        assert fitted(parts, 81) == ("  ".join(parts), 9)
        assert fitted(parts, 80) == ("  ".join(parts), 8)
        assert fitted(parts, 79) == ("  ".join(parts[1:]), 24)
        assert fitted(parts, 10) == ("ETA 1:02:03", 8)

    def test_many_workers(self, capsys: pytest.CaptureFixture[str]) -> None:
        with EncodeDisplay() as display:
            display(Progress(2, 6, 48, 132, 36.208, 1.07, 89.9, 1, 3, 2))
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith("1/3 chains, 2 workers  GOP 2/6  48/132 frames  36.21 dB")

    def test_more_gops_than_are_known(self, capsys: pytest.CaptureFixture[str]) -> None:
        with EncodeDisplay() as display:
            display(Progress(2, 6, 48, 132, 36.208, 1.07, 89.9, 1, 3, 2, analysed=False))
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith("1/3+ chains, 2 workers  GOP 2/6+  48/132 frames  36.21 dB")

    def test_json(self, capsys: pytest.CaptureFixture[str]) -> None:
        with EncodeJson() as display:
            display(Progress(2, 6, 48, 132, 36.208, 1.07, 89.9, 1, 3, 2))
            display.done({"path": "a.gsvr"})
        first, second = map(json.loads, capsys.readouterr().out.splitlines())
        assert first == {
            "event": "progress",
            "gop": 2,
            "gops": 6,
            "frames_done": 48,
            "frames": 132,
            "psnr": 36.208,
            "seconds_per_frame": 1.07,
            "eta_seconds": 89.9,
            "chains_done": 1,
            "chains": 3,
            "workers": 2,
            "analysed": True,
            "phase": "fitting",
            "frames_analysed": 0,
            "bitrate": None,
        }
        assert second == {"event": "done", "path": "a.gsvr"}

    def test_quiet(self, capsys: pytest.CaptureFixture[str]) -> None:
        with EncodeDisplay(quiet=True) as display:
            display(Progress(0, 6, 0, 132, None, None, None))
        assert capsys.readouterr().err == ""

    @pytest.mark.parametrize(("seconds", "text"), [(0, "0:00"), (75.4, "1:15"), (3723, "1:02:03")])
    def test_clock(self, seconds: float, text: str) -> None:
        assert clock(seconds) == text


class TestTerminal:
    def ask(self, answer: bytes, *args: str | Path) -> tuple[int, str]:
        """Run gsvrdec on a terminal and type an answer, again until it is taken."""
        import pty

        terminal, end = pty.openpty()
        process = start("gsvrdec", *args, stdin=end, stdout=end, stderr=end)
        os.close(end)
        shown = b""
        deadline = time.monotonic() + 20
        with suppress(OSError):  # Linux says so when the other end is closed and all is read
            while time.monotonic() < deadline:
                if select.select([terminal], [], [], 0.5)[0]:
                    shown += os.read(terminal, 4096)
                elif b"[y/N]" in shown:
                    os.write(terminal, answer)
        os.close(terminal)
        try:
            process.wait(timeout=5)
        finally:
            process.kill()
        return process.returncode, shown.decode()

    @pytest.mark.parametrize(("answer", "code"), [(b"n\n", 1), (b"y\n", 0)])
    def test_overwriting_is_asked(self, tmp_path: Path, answer: bytes, code: int) -> None:
        path = making.gsvr_file(tmp_path / "a.gsvr")
        target = tmp_path / "out.y4m"
        target.write_bytes(b"old")
        status, shown = self.ask(answer, path, target)
        assert status == code
        assert "out.y4m exists already. Overwrite it? [y/N]" in shown
        assert (target.read_bytes() == b"old") == (code != 0)
