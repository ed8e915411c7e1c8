"""What people type that cannot work: one sentence that says what to do, and nothing is written."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest

from tests import making
from tests.cli.tools import Runner

#: Commands in a directory with in.mp4, x.gsvr, bad.gsvr (one byte damaged), text.mp4, empty.mp4 and
#: dir; the exit code; a part of the sentence.
MISTAKES = [
    ("gsvrenc", 2, "usage: gsvrenc INPUT OUTPUT.gsvr; gsvrenc --help"),
    ("gsvrenc in.mp4", 2, "OUTPUT.gsvr is missing: gsvrenc INPUT OUTPUT.gsvr"),
    ("gsvrenc my film.mp4 o.gsvr", 2, "a name with spaces takes quotes"),
    ("gsvrenc none.mp4 o.gsvr", 1, "none.mp4 does not exist"),
    ("gsvrenc text.mp4 o.gsvr", 3, "text.mp4 is not a video that can be read"),
    ("gsvrenc empty.mp4 o.gsvr", 3, "it is empty"),
    ("gsvrenc x.gsvr o.gsvr", 3, "is a .gsvr file already"),
    ("gsvrenc dir o.gsvr", 1, "dir is a directory, not a file"),
    ("gsvrenc https://host/in.mp4 o.gsvr", 1, "download it, or pipe it in"),
    ("gsvrenc in_%04d.png o.gsvr", 1, "nor pictures with a number in its place"),
    ("gsvrenc in.mp4 dir", 1, "name a file in it"),
    ("gsvrenc in.mp4 x.gsvr", 1, "x.gsvr exists already; use -y to replace it"),
    ("gsvrenc in.mp4 none/o.gsvr", 1, "none is not a directory; create it first"),
    ("gsvrenc in.mp4 o.mp4", 2, "name it o.gsvr"),
    ("gsvrenc in.mp4 in.mp4", 1, "is the input itself"),
    ("gsvrenc -i in.mp4 -c:v x -crf 20 o.gsvr", 2, "-i: the input is named without -i"),
    ("gsvrenc in.mp4 -crf 20 o.gsvr", 2, "-crf: write --crf"),
    ("gsvrenc in.mp4 -vf scale=640:-2 o.gsvr", 2, "pipe ffmpeg into gsvrenc"),
    ("gsvrenc --crf 26 --bpp .1 in.mp4 o.gsvr", 2, "--crf and --bpp exclude each other; give one"),
    ("gsvrenc --crf 99 in.mp4 o.gsvr", 2, "--crf must be 0 to 51"),
    ("gsvrenc --crf high in.mp4 o.gsvr", 2, "'high' is not a valid float"),
    ("gsvrenc --preset fast in.mp4 o.gsvr", 2, "'fastest', 'medium', 'slow', 'slowest'"),
    ("gsvrenc --prset slow in.mp4 o.gsvr", 2, "'--preset'"),
    ("gsvrenc --crop 9000:10 in.mp4 o.gsvr", 2, "larger than the picture of in.mp4"),
    ("gsvrenc --rate 30 in.mp4 o.gsvr", 2, "in.mp4 has its own times"),
    ("gsvrenc --ss 5:00 in.mp4 o.gsvr", 2, "no frame starts in the chosen time"),
    ("gsvrenc --target-size 1kB --frames 4 in.mp4 o.gsvr", 2, "for 1 GOP of at least"),
    ("gsvrenc --resume in.mp4 -", 2, "an output on a disk"),
    ("gsvrdec x.gsvr", 2, "name an output, or -"),
    ("gsvrdec none.gsvr o.mp4", 1, "none.gsvr does not exist"),
    ("gsvrdec in.mp4 o.mp4", 3, "not a .gsvr file"),
    ("gsvrdec bad.gsvr o.mp4", 3, "--keep-going decodes what is intact"),
    ("gsvrdec x.gsvr o.avi", 2, "use a name in .mp4, .mkv, .y4m or .png"),
    ("gsvrdec x.gsvr o.png", 2, "as in out_%04d.png"),
    ("gsvrdec --size 10 x.gsvr o.mp4", 2, "such as 1280x720 or 1280x-2"),
    ("gsvrdec --ss 10 x.gsvr o.mp4", 2, "the video runs from"),
    ("gsvrdec --muxer mp4 x.gsvr -", 2, "choose y4m or mkv"),
    ("gsvrdec https://127.0.0.1:1/x.gsvr o.mp4", 1, "Cannot connect to host"),
    ("gsvrdec -r 30 x.gsvr o.mp4", 2, "-r: write --fps"),
    ("gsvrinfo in.mp4", 3, "not a .gsvr file"),
    ("gsvrreport in.mp4", 2, "is missing: gsvrreport SOURCE INPUT.gsvr ..."),
    ("gsvrreport x.gsvr in.mp4", 2, "the source comes first"),
    ("gsvrreport in.mp4 x.gsvr --against vp9", 2, "the encoders are x264, x265, svtav1"),
    ("gsvrreport in.mp4 x.gsvr --plot p.gif", 2, "as .png, .svg, .pdf"),
    ("gsvrplay in.mp4", 3, "not a .gsvr file"),
    ("gsvrplay dir", 3, "holds no .gsvr file"),
    ("gsvrplay x.gsvr --export dir", 1, "name a file in it"),
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("mistakes")
    (folder / "in.mp4").write_bytes(making.NOISE.read_bytes())
    whole = bytearray(making.gsvr_file(folder / "x.gsvr").read_bytes())
    whole[len(whole) // 2] ^= 1
    (folder / "bad.gsvr").write_bytes(whole)
    (folder / "text.mp4").write_text("hello\n")
    (folder / "empty.mp4").touch()
    (folder / "dir").mkdir()
    return folder


@pytest.mark.parametrize(("line", "code", "sentence"), MISTAKES, ids=[m[0] for m in MISTAKES])
def test_mistake(
    line: str,
    code: int,
    sentence: str,
    folder: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(folder)
    before = {path: path.stat().st_mtime_ns for path in folder.iterdir()}
    name, *arguments = shlex.split(line)
    assert sentence in Runner(capsys).fails(code, name, *arguments)
    assert {path: path.stat().st_mtime_ns for path in folder.iterdir()} == before
