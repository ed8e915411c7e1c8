"""gsvrplay: serving until Ctrl-C, exporting, failures."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from urllib.request import urlopen

import pytest

from gsvrcodec.play.collection import open_collection
from gsvrcodec.play.serve import open_server
from tests.cli.tools import ROOT, Runner, start

VALID = ROOT / "tests" / "vectors" / "valid"
FILM = VALID / "black.gsvr"
LINE = re.compile(r"(http://127\.0\.0\.1:(\d+)/) (.*); Ctrl-C ends it\n")


@pytest.fixture
def cli(capsys: pytest.CaptureFixture[str]) -> Runner:
    return Runner(capsys)


@contextmanager
def playing(
    *args: str | Path, environment: Mapping[str, str] | None = None
) -> Iterator[tuple[subprocess.Popen[bytes], str, str]]:
    """Start the command; yield it, its URL and what it says that it serves."""
    process = start(
        "gsvrplay",
        *args,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        environment=environment,
    )
    try:
        assert process.stdout is not None
        line = LINE.fullmatch(process.stdout.readline().decode())
        assert line is not None
        yield process, line[1], line[3]
    finally:
        process.kill()
        process.communicate()


class TestServing:
    @pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
    def test_ends_quietly(self, number: signal.Signals) -> None:
        with playing(FILM, "--no-browser", "--port", "0") as (process, url, what):
            assert what == f"plays {FILM}"
            with urlopen(f"{url}films/black.gsvr", timeout=20) as answer:
                assert answer.read() == FILM.read_bytes()
            process.send_signal(number)
            out, err = process.communicate(timeout=20)
            assert (process.returncode, out, err) == (0, b"", b"")

    def test_ends_while_a_film_is_on_its_way(self, tmp_path: Path) -> None:
        film = Path(shutil.copy(FILM, tmp_path / "a.gsvr"))
        os.truncate(film, 2**26)
        with playing(film, "--no-browser", "--port", "0") as (process, url, _):
            with urlopen(f"{url}films/a.gsvr", timeout=20) as answer:
                answer.read(100)
                process.send_signal(signal.SIGINT)
                assert process.communicate(timeout=20) == (b"", b"")
            assert process.returncode == 0

    def test_a_directory(self) -> None:
        with playing(VALID, "--no-browser") as (_, url, what):
            assert what == f"shows {len(list(VALID.glob('*.gsvr')))} films of {VALID}"
            with urlopen(f"{url}films.json", timeout=20) as answer:
                assert answer.status == 200

    def test_opens_the_browser(self, tmp_path: Path) -> None:
        opened, browser = tmp_path / "opened", tmp_path / "browser"
        browser.write_text(
            f'#!/bin/sh\nprintf %s "$1" > {opened}.part\nmv {opened}.part {opened}\n'
        )
        browser.chmod(0o755)
        with playing(FILM, "--port", "0", environment={"BROWSER": f"{browser} %s"}) as (_, url, _):
            deadline = time.monotonic() + 20
            while not opened.exists():
                assert time.monotonic() < deadline
                time.sleep(0.01)
            assert opened.read_text() == url

    def test_no_browser_is_no_failure(self, tmp_path: Path) -> None:
        nothing = {"PATH": str(tmp_path), "BROWSER": "none"}
        with playing(FILM, "--port", "0", environment=nothing) as (process, url, _):
            with urlopen(f"{url}films.json", timeout=20) as answer:
                assert answer.status == 200
            process.send_signal(signal.SIGINT)
            assert process.communicate(timeout=20) == (b"", b"")
            assert process.returncode == 0

    def test_a_port_that_is_taken_fails(self, cli: Runner) -> None:
        with open_server(open_collection(FILM), port=0) as server:
            port = server.server_address[1]
            line = cli.fails(1, "gsvrplay", FILM, "--no-browser", "--port", str(port))
        assert line == f"port {port} of 127.0.0.1 is in use already; choose another --port"

    def test_an_address_of_others_fails(self, cli: Runner) -> None:
        line = cli.fails(1, "gsvrplay", FILM, "--no-browser", "--host", "192.0.2.1")
        assert line.startswith("cannot listen at port 0 of 192.0.2.1: ")


class TestExport:
    def test_writes_a_page(self, cli: Runner, tmp_path: Path) -> None:
        page = tmp_path / "film.html"
        result = cli("gsvrplay", FILM, "--export", page)
        assert (result.code, result.out, result.err) == (0, "", "")
        assert 'id="film" data-name="black.gsvr"' in page.read_text("utf-8")
        assert cli("gsvrplay", FILM, "--export", "-").out == page.read_text("utf-8")

    def test_an_existing_page_is_kept(self, cli: Runner, tmp_path: Path) -> None:
        page = tmp_path / "film.html"
        page.write_text("old")
        assert "use -y" in cli.fails(1, "gsvrplay", FILM, "--export", page)
        assert page.read_text() == "old"
        assert cli("gsvrplay", FILM, "--export", page, "-y").code == 0
        assert page.read_text("utf-8").startswith("<!")

    def test_a_directory_fails(self, cli: Runner, tmp_path: Path) -> None:
        line = cli.fails(2, "gsvrplay", VALID, "--export", tmp_path / "film.html")
        assert "--export is for one film" in line
        assert not list(tmp_path.iterdir())

    @pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
    def test_a_full_disk_fails(self, cli: Runner) -> None:
        line = cli.fails(1, "gsvrplay", FILM, "--export", "/dev/full")
        assert "no space left on device" in line

    def test_is_light(self, tmp_path: Path) -> None:
        code = f"""
import sys
from gsvrcodec.cli.play import main
import gsvrcodec.play.serve
assert main([{str(FILM)!r}, "--export", {str(tmp_path / "film.html")!r}]) == 0
assert not {{"torch", "cv2", "av", "numpy", "rich"}} & set(sys.modules)
"""
        subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)


class TestInputs:
    @pytest.mark.parametrize("content", [b"", b"text\n" * 9])
    def test_another_file_fails(self, cli: Runner, tmp_path: Path, content: bytes) -> None:
        other = tmp_path / "a.gsvr"
        other.write_bytes(content)
        assert cli.fails(3, "gsvrplay", other).startswith(f"{other}: not a .gsvr file: ")

    def test_an_empty_directory_fails(self, cli: Runner, tmp_path: Path) -> None:
        assert cli.fails(3, "gsvrplay", tmp_path) == f"{tmp_path} holds no .gsvr file"

    def test_a_pipe_fails(self, cli: Runner) -> None:
        assert "- is no file or directory" in cli.fails(1, "gsvrplay", "-")

    @pytest.mark.parametrize("port", ["-1", "65536", "http"])
    def test_a_port_out_of_range_fails(self, cli: Runner, port: str) -> None:
        assert "--port" in cli.fails(2, "gsvrplay", FILM, "--port", port)
