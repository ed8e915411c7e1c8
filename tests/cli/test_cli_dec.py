"""gsvrdec: every output, ranges, and damaged files."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

import numpy as np
import pytest

import gsvrcodec
from gsvrcodec.video import open_video
from tests import making
from tests.cli.tools import Runner


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

    @pytest.mark.parametrize("args", [["--start-frame", "-1"], ["--frames", "0"]])
    def test_nonsense_fails(self, cli: Runner, path: Path, args: list[str]) -> None:
        cli.fails(2, "gsvrdec", path, "o.mp4", *args)


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
        assert "chunk GOPD at byte" in cli.fails(3, "gsvrdec", path, tmp_path / "out.mkv")
        assert list(tmp_path.iterdir()) == [path]
        result = cli("gsvrdec", path, tmp_path / "out.mkv", "--keep-going")
        assert result.code == 5
        assert "gsvrdec: warning: frames 5 to 7 are left out" in result.err
        assert [frame.rgb.tobytes() for frame in open_video(tmp_path / "out.mkv")] == [
            *whole[:5],
            *whole[8:],
        ]

    def test_sound_file_keeps_going_too(self, cli: Runner, path: Path) -> None:
        assert cli("gsvrdec", path, "--muxer", "null", "--keep-going").code == 0
