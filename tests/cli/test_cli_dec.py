"""gsvrdec: every output, ranges, and damaged files."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from subprocess import PIPE

import click
import numpy as np
import pytest

import gsvrcodec
from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.cli import dec
from gsvrcodec.video import open_video
from tests import making
from tests.cli.tools import Runner, start
from tests.vectors.make import VALID


@pytest.fixture
def cli(capsys: pytest.CaptureFixture[str]) -> Runner:
    return Runner(capsys)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return making.gsvr_file(tmp_path / "a.gsvr", rotation=270)


def pictures(path: Path) -> list[bytes]:
    with gsvrcodec.open(path) as decoder:
        return [frame.data.tobytes() for frame in decoder]


class TestOutputs:
    @pytest.mark.parametrize("suffix", [".mp4", ".mkv", ".y4m"])
    def test_video(self, cli: Runner, path: Path, tmp_path: Path, suffix: str) -> None:
        target = tmp_path / f"out{suffix}"
        result = cli("gsvrdec", path, target)
        assert result.code == 0
        assert result.out == ""
        assert result.err.startswith("12 frames in ")
        video = open_video(target)
        times = [frame.pts * video.info.time_base * 25 for frame in video]
        assert times == list(range(12))
        if suffix != ".y4m":
            assert video.info.rotation == 270
        if suffix == ".mkv":
            assert [frame.rgb.tobytes() for frame in video] == pictures(path)

    def test_pictures(self, cli: Runner, path: Path, tmp_path: Path) -> None:
        assert cli("gsvrdec", path, tmp_path / "out_%04d.png", "--quiet").err == ""
        names = sorted(name.name for name in tmp_path.glob("*.png"))
        assert names == [f"out_{number:04}.png" for number in range(12)]
        (frame,) = open_video(tmp_path / "out_0007.png")
        assert frame.rgb.tobytes() == pictures(path)[7]

    def test_md5(self, cli: Runner, path: Path) -> None:
        expected = hashlib.md5(b"".join(pictures(path))).hexdigest()
        for args in ([], ["-"]):
            assert cli("gsvrdec", path, *args, "--muxer", "md5").out == f"{expected}\n"

    def test_null(self, cli: Runner, path: Path, tmp_path: Path) -> None:
        assert cli("gsvrdec", "--muxer=null", path).code == 0
        assert list(tmp_path.iterdir()) == [path]

    def test_muxer_wins_over_the_name(self, cli: Runner, path: Path, tmp_path: Path) -> None:
        assert cli("gsvrdec", path, tmp_path / "out.bin", "--muxer", "y4m").code == 0
        assert (tmp_path / "out.bin").read_bytes().startswith(b"YUV4MPEG2")

    def test_quality(self, cli: Runner, path: Path, tmp_path: Path) -> None:
        args = ("--crf", "40", "--codec-preset", "ultrafast")
        assert cli("gsvrdec", path, tmp_path / "rough.mp4", *args).code == 0
        assert cli("gsvrdec", path, tmp_path / "fine.mp4").code == 0
        assert (tmp_path / "rough.mp4").stat().st_size < (tmp_path / "fine.mp4").stat().st_size


class TestRanges:
    @pytest.mark.parametrize(
        ("args", "numbers"),
        [
            (["--start-frame", "4"], range(4, 12)),
            (["--frames", "3"], range(3)),
            (["--start-frame", "7", "--frames", "2"], range(7, 9)),
            (["--start-frame", "11", "--frames", "100"], range(11, 12)),
        ],
    )
    def test_original_times(
        self, cli: Runner, path: Path, tmp_path: Path, args: list[str], numbers: range
    ) -> None:
        assert cli("gsvrdec", path, tmp_path / "out.mkv", *args).code == 0
        frames = list(open_video(tmp_path / "out.mkv"))
        assert [frame.rgb.tobytes() for frame in frames] == [pictures(path)[n] for n in numbers]
        assert [frame.pts for frame in frames] == [40 * number for number in numbers]
        assert cli("gsvrdec", path, tmp_path / "out.mp4", *args).code == 0
        assert [frame.pts for frame in open_video(tmp_path / "out.mp4")] == [
            512 * number for number in numbers
        ]

    def test_past_the_end_fails(self, cli: Runner, path: Path, tmp_path: Path) -> None:
        line = cli.fails(2, "gsvrdec", path, tmp_path / "o.mp4", "--start-frame", "12")
        assert "the video has 12 frames" in line
        assert list(tmp_path.iterdir()) == [path]

    @pytest.mark.parametrize(
        ("args", "numbers"),
        [
            (["--ss", "0.16"], range(4, 12)),
            (["--ss", "0:00.161"], range(5, 12)),
            (["--to", "0:00:00.16"], range(4)),
            (["--ss", "0.16", "--to", "0.24"], range(4, 6)),
            (["--ss=0.16", "--frames=3"], range(4, 7)),
            (["--start-frame=3", "--to=0.2"], range(3, 5)),
        ],
        ids=str,
    )
    def test_times(
        self, cli: Runner, path: Path, tmp_path: Path, args: list[str], numbers: range
    ) -> None:
        assert cli("gsvrdec", path, tmp_path / "out.mkv", *args).code == 0
        frames = list(open_video(tmp_path / "out.mkv"))
        assert [frame.pts for frame in frames] == [40 * number for number in numbers]

    @pytest.mark.parametrize(
        ("args", "message"),
        [
            (["--ss", "0.1", "--start-frame", "3"], "--ss and --start-frame exclude each other"),
            (["--to", "0.1", "--frames", "3"], "--to and --frames exclude each other"),
            (["--ss", "0.3", "--to", "0.2"], "no frame starts in this part"),
            (["--ss", "9"], "the video runs from 0 s to 0.48 s"),
            (["--ss", "1:2:3:4"], "'1:2:3:4' is not a time such as 90.5"),
            (["--ss", "-1"], "'-1' is not a time"),
            (["--to", "nan"], "'nan' is not a time"),
        ],
        ids=str,
    )
    def test_contradictions_fail(
        self, cli: Runner, path: Path, tmp_path: Path, args: list[str], message: str
    ) -> None:
        assert message in cli.fails(2, "gsvrdec", path, tmp_path / "out.mkv", *args)
        assert list(tmp_path.iterdir()) == [path]

    @pytest.mark.parametrize("args", [["--start-frame", "-1"], ["--frames", "0"]])
    def test_nonsense_fails(self, cli: Runner, path: Path, args: list[str]) -> None:
        cli.fails(2, "gsvrdec", path, "o.mp4", *args)


class TestPictures:
    def test_rate_speed_and_scale(self, cli: Runner, path: Path, tmp_path: Path) -> None:
        args = ("--fps", "30000/1001", "--speed", "0.5", "--scale", "1.5")
        assert cli("gsvrdec", path, tmp_path / "out.mkv", *args).code == 0
        video = open_video(tmp_path / "out.mkv")
        assert (video.info.width, video.info.height) == (72, 48)
        times = [int(1001 * number / 30 + 0.5) for number in range(29)]
        assert [frame.pts for frame in video] == times

    @pytest.mark.parametrize("size", ["96x64", "96:-1", "-2x64"])
    def test_size(self, cli: Runner, path: Path, tmp_path: Path, size: str) -> None:
        assert cli("gsvrdec", path, tmp_path / "out.mp4", "--size", size).code == 0
        info = open_video(tmp_path / "out.mp4").info
        assert (info.width, info.height) == (96, 64)

    def test_layers(self, cli: Runner, tmp_path: Path) -> None:
        path = making.gsvr_file(tmp_path / "shot.gsvr", one_shot=True)
        sums = {
            cli("gsvrdec", path, "--muxer", "md5", "--layers", layers).out
            for layers in ("all", "dynamic", "static")
        }
        assert len(sums) == 3

    def test_bit_depth(self, cli: Runner, tmp_path: Path) -> None:
        path = making.gsvr_file(tmp_path / "deep.gsvr", frames=(2,), bit_depth=10)
        for depth, bits in (("auto", 10), ("8", 8), ("10", 10)):
            args = (path, tmp_path / "out.mkv", "-y", "--bit-depth", depth)
            assert cli("gsvrdec", *args).code == 0
            assert open_video(tmp_path / "out.mkv").info.bit_depth == bits

    @pytest.mark.parametrize(
        ("args", "code", "message"),
        [
            (["--size", "96x64", "--scale", "2"], 2, "--size or --scale, not both"),
            (["--size", "96"], 2, "'96' is not WxH in pixels"),
            (["--size", "-3x9"], 2, "'-3x9' is not WxH in pixels"),
            (["--size", "-1x-1"], 2, "both cannot follow"),
            (["--scale", "0"], 2, "a scale must be a number over 0"),
            (["--scale", "nan"], 2, "a scale must be a number over 0"),
            (["--scale", "1e6"], 4, "raise it with GSVR_LIMIT_WIDTH"),
            (["--fps", "0"], 2, "the frame rate must be over 0"),
            (["--fps", "1/0"], 2, "'1/0' is not a number"),
            (["--fps", "1e9"], 2, "'1e9' is not a number"),
            (["--speed", "0.0"], 2, "the speed must be over 0"),
            (["--layers", "moving"], 2, "'moving' is not one of 'all', 'dynamic', 'static'"),
        ],
        ids=str,
    )
    def test_nonsense_fails(
        self, cli: Runner, path: Path, tmp_path: Path, args: list[str], code: int, message: str
    ) -> None:
        assert message in cli.fails(code, "gsvrdec", path, tmp_path / "out.mp4", *args)
        assert list(tmp_path.iterdir()) == [path]


class TestHelp:
    def test_every_option_is_under_a_heading(self, cli: Runner) -> None:
        text = cli("gsvrdec", "--help").out
        headings = re.findall(r"^(\w[\w ]*):$", text, re.MULTILINE)
        assert headings == ["Part of the film", "Pictures", "Output", "General"]
        listed = {name for names in dec._GROUPS.values() for name in names}
        options = [p for p in dec.command.params if isinstance(p, click.Option)]
        assert {option.name for option in options} <= listed
        for option in options:
            assert text.count(f"\n  {', '.join(option.opts)}") == 1


class TestNames:
    """Fault 24."""

    @pytest.mark.parametrize("name", ["with space", "ünïcödé 映画", "-leading", "a'b\"c", "100%"])
    def test_odd_names(
        self, cli: Runner, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
    ) -> None:
        monkeypatch.chdir(tmp_path)
        making.gsvr_file(tmp_path / f"{name}.gsvr", frames=(2,))
        result = cli("gsvrdec", "-q", "--", f"{name}.gsvr", f"{name}.mkv")
        assert (result.code, result.err) == (0, "")
        assert len(list(open_video(tmp_path / f"{name}.mkv"))) == 2

    def test_leading_dash_with_a_directory(
        self, cli: Runner, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.chdir(tmp_path)
        making.gsvr_file(tmp_path / "-a.gsvr", frames=(2,))
        assert cli("gsvrdec", "./-a.gsvr", "./-a.y4m").code == 0
        assert (tmp_path / "-a.y4m").exists()


class TestPipes:
    """Outputs that cannot be rewound."""

    def test_stdout_is_the_same_y4m(self, cli: Runner, path: Path, tmp_path: Path) -> None:
        assert cli("gsvrdec", path, tmp_path / "out.y4m", "--fps", "50").code == 0
        process = start("gsvrdec", path, "-", "--fps", "50", stdout=PIPE, stderr=PIPE)
        out, err = process.communicate(timeout=60)
        assert process.returncode == 0
        assert out == (tmp_path / "out.y4m").read_bytes()
        assert err.decode().startswith("24 frames in ")

    @pytest.mark.parametrize("name", ["stream", "stream-growing"])
    def test_stdin_is_decoded_as_it_comes(self, name: str) -> None:
        vector = VALID / f"{name}.gsvr"
        with GsvrReader(vector) as reader:
            first = reader.gops[0].chunk.end
        process = start("gsvrdec", "-", "-", "-q", "--muxer", "y4m", stdin=PIPE, stdout=PIPE)
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write(vector.read_bytes()[:first])
        process.stdin.flush()
        line = process.stdout.readline()
        assert line.startswith(b"YUV4MPEG2 W64 H48 F25:1 ")
        frame = process.stdout.read(len(b"FRAME\n") + 64 * 48)
        assert frame.startswith(b"FRAME\n")
        process.stdin.write(vector.read_bytes()[first:])
        process.stdin.close()
        rest = process.stdout.read()
        process.stdout.close()
        assert process.wait(timeout=60) == 0
        whole = start("gsvrdec", vector, "-", "-q", stdout=PIPE)
        assert line + frame + rest == whole.communicate(timeout=60)[0]

    @pytest.mark.parametrize(("cut", "code"), [(1000, 3), (0, 0)])
    def test_stdin_that_is_no_stream(self, path: Path, cut: int, code: int) -> None:
        """A file is decoded as it comes too; if its end is missing, it is damaged."""
        data = path.read_bytes()
        process = start("gsvrdec", "-", "-q", "--muxer", "null", stdin=PIPE, stderr=PIPE)
        err = process.communicate(data[: len(data) - cut], timeout=60)[1].decode()
        assert process.returncode == code
        assert ("-: the file is cut short or damaged" in err) == bool(code)

    def test_named_pipe(self, cli: Runner, path: Path, tmp_path: Path) -> None:
        os.mkfifo(tmp_path / "pipe.mkv")
        with ThreadPoolExecutor(1) as pool:
            data = pool.submit((tmp_path / "pipe.mkv").read_bytes)
            assert cli("gsvrdec", path, tmp_path / "pipe.mkv").code == 0
        (tmp_path / "out.mkv").write_bytes(data.result())
        frames = list(open_video(tmp_path / "out.mkv"))
        assert [frame.rgb.tobytes() for frame in frames] == pictures(path)

    def test_mp4_needs_a_file(self, cli: Runner, path: Path, tmp_path: Path) -> None:
        assert "name a file" in cli.fails(2, "gsvrdec", path, "-", "--muxer", "mp4")

    def test_matroska_through_a_pipe(self, path: Path, tmp_path: Path) -> None:
        process = start("gsvrdec", path, "-", "--muxer", "mkv", stdout=PIPE, stderr=PIPE)
        data, errors = process.communicate()
        assert process.returncode == 0, errors
        (tmp_path / "out.mkv").write_bytes(data)
        assert [frame.rgb.tobytes() for frame in open_video(tmp_path / "out.mkv")] == pictures(path)

    @pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="there is no ffmpeg program")
    def test_ffmpeg_takes_it(self, path: Path, tmp_path: Path) -> None:
        source = start("gsvrdec", path, "-", "--scale", "2", stdout=PIPE, stderr=PIPE)
        ffmpeg = subprocess.run(
            ["ffmpeg", "-v", "error", "-i", "-", "-c:v", "ffv1", str(tmp_path / "out.mkv")],
            stdin=source.stdout,
            stderr=PIPE,
            timeout=60,
            check=True,
        )
        source.communicate(timeout=60)
        assert (source.returncode, ffmpeg.stderr) == (0, b"")
        video = open_video(tmp_path / "out.mkv")
        assert (video.info.width, video.info.height) == (96, 64)
        assert [frame.pts for frame in video] == [40 * number for number in range(12)]


class TestBadInput:
    def test_no_output_fails(self, cli: Runner, path: Path) -> None:
        assert "name an output" in cli.fails(2, "gsvrdec", path)

    def test_unknown_output_fails(self, cli: Runner, path: Path, tmp_path: Path) -> None:
        assert ".mp4, .mkv, .y4m or .png" in cli.fails(2, "gsvrdec", path, tmp_path / "out.avi")

    def test_existing_output_fails(self, cli: Runner, path: Path, tmp_path: Path) -> None:
        target = tmp_path / "out.mp4"
        target.write_bytes(b"old")
        assert "use -y" in cli.fails(1, "gsvrdec", path, target)
        assert target.read_bytes() == b"old"
        assert cli("gsvrdec", path, target, "-y").code == 0
        assert len(list(open_video(target))) == 12

    @pytest.mark.parametrize("link", [os.symlink, os.link], ids=["soft", "hard"])
    def test_output_is_input_fails(
        self, cli: Runner, path: Path, tmp_path: Path, link: object
    ) -> None:
        assert callable(link)
        before = path.read_bytes()
        link(path, tmp_path / "out.y4m")
        assert "the input itself" in cli.fails(1, "gsvrdec", path, tmp_path / "out.y4m", "-y")
        assert path.read_bytes() == before

    def test_directory_fails(self, cli: Runner, tmp_path: Path) -> None:
        assert "is a directory" in cli.fails(1, "gsvrdec", tmp_path, tmp_path / "out.mp4")

    @pytest.mark.parametrize("content", [b"", b"\x89", b"GSV", b"text\n" * 99])
    def test_other_file_fails(self, cli: Runner, tmp_path: Path, content: bytes) -> None:
        other = tmp_path / "b.gsvr"
        other.write_bytes(content)
        line = cli.fails(3, "gsvrdec", other, tmp_path / "out.mp4")
        assert f"{other}: not a .gsvr file" in line
        assert list(tmp_path.iterdir()) == [other]

    def test_video_fails(self, cli: Runner, tmp_path: Path) -> None:
        assert "not a .gsvr file" in cli.fails(3, "gsvrdec", making.NOISE, tmp_path / "out.mp4")


class TestDamage:
    @pytest.fixture
    def cut(self, path: Path) -> Path:
        path.write_bytes(path.read_bytes()[:-2500])
        return path

    def test_cut_short_fails(self, cli: Runner, cut: Path, tmp_path: Path) -> None:
        line = cli.fails(3, "gsvrdec", cut, tmp_path / "out.mp4")
        assert "8 frames were found, which --keep-going decodes" in line
        assert list(tmp_path.iterdir()) == [cut]

    def test_keep_going_is_partial(self, cli: Runner, cut: Path, tmp_path: Path) -> None:
        result = cli("gsvrdec", cut, tmp_path / "out.mkv", "--keep-going")
        assert result.code == 5
        assert "is damaged: 8 frames were written, 0 lost" in result.err
        assert len(list(open_video(tmp_path / "out.mkv"))) == 8

    def test_flipped_bit(self, cli: Runner, path: Path, tmp_path: Path) -> None:
        whole = pictures(path)
        data = np.frombuffer(path.read_bytes(), np.uint8).copy()
        data[len(data) // 2] ^= 1
        path.write_bytes(data.tobytes())
        line = cli.fails(3, "gsvrdec", path, tmp_path / "out.mkv")
        assert "chunk GOPD at byte" in line
        assert line.endswith("--keep-going decodes what is intact")
        assert list(tmp_path.iterdir()) == [path]
        result = cli("gsvrdec", path, tmp_path / "out.mkv", "--keep-going")
        assert result.code == 5
        assert "gsvrdec: warning: frames 5 to 7 are left out" in result.err
        assert [frame.rgb.tobytes() for frame in open_video(tmp_path / "out.mkv")] == [
            *whole[:5],
            *whole[8:],
        ]

    def test_flipped_bit_in_a_chain(self, cli: Runner, tmp_path: Path) -> None:
        path = making.gsvr_file(tmp_path / "a.gsvr", frames=(5, 3, 4), predicted=True)
        whole = pictures(path)
        data = bytearray(path.read_bytes())
        data[len(data) // 2] ^= 1
        path.write_bytes(data)
        result = cli("gsvrdec", path, tmp_path / "out.mkv", "--keep-going")
        assert result.code == 5
        assert "gsvrdec: warning: frames 5 to 7 are left out" in result.err
        assert "the GOP at frame 8 is predicted from this one" in result.err
        assert "5 frames were written, 7 lost" in result.err
        found = [frame.rgb.tobytes() for frame in open_video(tmp_path / "out.mkv")]
        assert found == whole[:5]
        assert cli("gsvrdec", path, "--muxer", "null", "--fps", "60", "--keep-going").code == 5

    def test_sound_file_keeps_going_too(self, cli: Runner, path: Path) -> None:
        assert cli("gsvrdec", path, "--muxer", "null", "--keep-going").code == 0
