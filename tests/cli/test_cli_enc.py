"""gsvrenc: one small encode, and all that is refused before anything is done."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import gsvrcodec
from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.cli import enc
from gsvrcodec.encoder.settings import EncodeSettings
from tests import making
from tests.cli.tools import ROOT, Runner, start

SMALL = (
    *("--frames", "4", "--gop", "2", "--gaussians", "0.2k"),
    *("--preset", "fastest", "--pack", "deflate"),
)


@pytest.fixture
def cli(capsys: pytest.CaptureFixture[str]) -> Runner:
    return Runner(capsys)


def test_options_are_the_settings() -> None:
    chosen = enc.command.make_context("gsvrenc", ["in.mp4", "out.gsvr"]).params
    for name in (
        *("source", "target", "overwrite", "resume", "verify", "stats"),
        "progress",
        "quiet",
        "cluster",
        "shared_source",
    ):
        del chosen[name]
    assert EncodeSettings(**chosen) == EncodeSettings()
    assert set(chosen) == set(EncodeSettings.__dataclass_fields__)


def test_every_option_has_its_heading() -> None:
    grouped = {name for names in enc._GROUPS.values() for name in names}
    assert {option.name for option in enc.command.params} - {"source", "target"} <= grouped


def test_small_encode(cli: Runner, tmp_path: Path) -> None:
    target = tmp_path / "out.gsvr"
    args = (making.NOISE, target, *SMALL, "--crop", "64:48", "--start-frame", "3")
    result = cli("gsvrenc", *args)
    assert result.code == 0, result.err
    assert result.out == ""
    assert "GOP 1/2  2/4 frames" in result.err
    first, *_, last = result.err.splitlines()
    assert first == f"{making.NOISE}: 64x48, 15 fps, h264, 4 frames, about 0:00"
    assert f"{target}: 4 frames, {target.stat().st_size:,} bytes" in last
    with gsvrcodec.open(target) as decoder:
        assert decoder[0].data.shape == (48, 64, 3)
        assert [frame.pts for frame in decoder] == [1024 * number for number in range(3, 7)]
    report = cli("gsvrreport", making.NOISE, target)
    assert report.code == 0
    assert "warning" not in report.err
    before = target.read_bytes()
    assert "use -y" in cli.fails(1, "gsvrenc", *args)
    assert target.read_bytes() == before


def test_a_shared_source_is_a_file_for_a_cluster(cli: Runner, tmp_path: Path) -> None:
    target = tmp_path / "out.gsvr"
    assert "for the workers of a --cluster" in cli.fails(
        2, "gsvrenc", making.NOISE, target, "--shared-source"
    )
    assert "not a pipe" in cli.fails(
        2, "gsvrenc", "-", target, "--shared-source", "--cluster", "auto"
    )


def test_json_stats_and_verification(cli: Runner, tmp_path: Path) -> None:
    target, stats = tmp_path / "out.gsvr", tmp_path / "stats.json"
    args = ("--progress", "json", "--stats", stats, "--verify", "--workers", "1")
    result = cli("gsvrenc", making.NOISE, target, *SMALL, *args)
    assert result.code == 0, result.err
    assert result.err == ""
    lines = [json.loads(line) for line in result.out.splitlines()]
    assert [line["event"] for line in lines] == ["progress"] * len(lines[:-1]) + ["done"]
    stages = [(line["phase"], line["gop"]) for line in lines[:-1]]
    assert list(dict.fromkeys(stages)) == [
        ("analysing", 0),
        *(("fitting", number) for number in range(3)),
        ("verifying", 2),
    ]
    written = json.loads(stats.read_text())
    gops = written.pop("gop_stats")
    assert written.pop("settings")["gaussians"] == 200
    assert lines[-1] == {"event": "done", **written}
    assert written["bytes"] == target.stat().st_size
    assert [(gop["first_frame"], gop["frames"], gop["gaussians"]) for gop in gops] == [
        (0, 2, 200),
        (2, 2, 200),
    ]
    assert sum(gop["psnr"] for gop in gops) / 2 == pytest.approx(written["psnr"])


def test_rate_options(cli: Runner, tmp_path: Path) -> None:
    target = tmp_path / "out.gsvr"
    line = cli.fails(2, "gsvrenc", making.NOISE, target, "--bitrate", "1.5M", "--bpp", "0.2")
    assert "--bpp and --bitrate exclude each other" in line
    args = ("-q", "--target-size", "1kB", *SMALL[:4])
    line = cli.fails(2, "gsvrenc", making.NOISE, target, *args)
    assert "--target-size 1000 leaves" in line
    assert not list(tmp_path.iterdir())


class TestStandardOutput:
    def test_is_a_stream_of_the_same_gops(self, tmp_path: Path) -> None:
        environment = {"TMPDIR": str(tmp_path)}
        gsvrenc = ("gsvrenc", making.NOISE)
        process = start(
            *gsvrenc, "-", "-q", *SMALL, stdout=subprocess.PIPE, environment=environment
        )
        piped = process.communicate(timeout=120)[0]
        assert process.returncode == 0
        assert start(*gsvrenc, tmp_path / "a.gsvr", "-q", *SMALL).wait(timeout=120) == 0
        assert [path.name for path in tmp_path.iterdir()] == ["a.gsvr"]
        with GsvrReader(piped) as stream, GsvrReader(tmp_path / "a.gsvr") as file:
            assert (stream.header.stream, file.header.stream) == (True, False)
            assert stream.warnings == file.warnings == ()
            assert [stream.read_gop(n) for n in range(len(stream.gops))] == [
                file.read_gop(n) for n in range(len(file.gops))
            ]
            assert stream.settings() == file.settings()

    def test_goes_into_the_decoder(self, cli: Runner, tmp_path: Path) -> None:
        encoder = start("gsvrenc", making.NOISE, "-", "-q", *SMALL, stdout=subprocess.PIPE)
        decoder = start(
            *("gsvrdec", "-", "-q", "--muxer", "md5"),
            stdin=encoder.stdout,
            stdout=subprocess.PIPE,
        )
        assert encoder.stdout is not None
        encoder.stdout.close()
        piped = decoder.communicate(timeout=120)[0]
        assert encoder.wait(timeout=120) == decoder.returncode == 0
        assert cli("gsvrenc", making.NOISE, tmp_path / "a.gsvr", "-q", *SMALL).code == 0
        assert cli("gsvrdec", tmp_path / "a.gsvr", "-q", "--muxer", "md5").out == piped.decode()

    def test_holds_one_thing_fails(self, cli: Runner, tmp_path: Path) -> None:
        for args in (["-", "--stats", "-"], ["-", "--progress", "json"]):
            line = cli.fails(2, "gsvrenc", making.NOISE, *args)
            assert "only one thing can go to the standard output" in line

    def test_cannot_be_resumed(self, cli: Runner) -> None:
        line = cli.fails(2, "gsvrenc", making.NOISE, "-", "--resume")
        assert "--resume needs an input that can be read again" in line


class TestBadInput:
    def fails(self, cli: Runner, code: int, source: Path, tmp_path: Path, *args: str) -> str:
        """Encode what must be refused; nothing may be written."""
        before = set(tmp_path.iterdir())
        line = cli.fails(code, "gsvrenc", source, tmp_path / "out.gsvr", *args)
        assert set(tmp_path.iterdir()) == before
        return line

    def test_directory_fails(self, cli: Runner, tmp_path: Path) -> None:
        assert "is a directory" in self.fails(cli, 1, tmp_path, tmp_path)

    def test_text_fails(self, cli: Runner, tmp_path: Path) -> None:
        text = tmp_path / "a.txt"
        text.write_text("no video here\n" * 20)
        assert "is not a video" in self.fails(cli, 3, text, tmp_path)

    def test_audio_only_fails(self, cli: Runner, tmp_path: Path) -> None:
        audio = making.audio_only(tmp_path / "a.wav")
        assert "no video stream" in self.fails(cli, 3, audio, tmp_path)

    def test_zero_frames_fails(self, cli: Runner, tmp_path: Path) -> None:
        empty = making.zero_frames(tmp_path / "a.y4m")
        assert "no video frames" in self.fails(cli, 3, empty, tmp_path)

    def test_gsvr_fails(self, cli: Runner, tmp_path: Path) -> None:
        coded = making.gsvr_file(tmp_path / "a.gsvr")
        assert "is a .gsvr file already" in self.fails(cli, 3, coded, tmp_path)

    def test_large_crop_fails(self, cli: Runner, tmp_path: Path) -> None:
        line = self.fails(cli, 2, making.NOISE, tmp_path, "--crop", "161:120")
        assert "larger than the picture" in line
        assert "(160x120)" in line

    def test_start_past_the_end_fails(self, cli: Runner, tmp_path: Path) -> None:
        line = self.fails(cli, 2, making.NOISE, tmp_path, "--start-frame", "20")
        assert "has 20 frames" in line

    @pytest.mark.parametrize(
        "args",
        [
            ["--params", "3M", "--gaussians", "2k"],
            ["--preset", "fastest", "--time-budget", "2"],
            ["--gop-min", "30", "--gop-max", "20"],
            ["--time-budget", "0"],
            ["--time-budget", "nan"],
            ["--params", "lots"],
            ["--params", "0"],
            ["--gop", "x"],
            ["--gop", "0"],
            ["--crop", "640"],
            ["--frames", "0"],
            ["--preset", "quick"],
        ],
        ids=" ".join,
    )
    def test_contradictions_fail(self, cli: Runner, tmp_path: Path, args: list[str]) -> None:
        assert args[0] in self.fails(cli, 2, making.NOISE, tmp_path, *args)

    def test_output_is_input_fails(self, cli: Runner, tmp_path: Path) -> None:
        source = tmp_path / "a.mp4"
        source.write_bytes(making.NOISE.read_bytes())
        os.link(source, tmp_path / "hard.gsvr")
        (tmp_path / "soft.gsvr").symlink_to(source)
        for name in ("a.mp4", "hard.gsvr", "soft.gsvr"):
            line = cli.fails(1, "gsvrenc", source, tmp_path / name, "-y")
            assert "is the input itself" in line
        assert source.read_bytes() == making.NOISE.read_bytes()

    def test_name_of_another_format_fails(self, cli: Runner, tmp_path: Path) -> None:
        assert "name it q.gsvr" in cli.fails(2, "gsvrenc", making.NOISE, "q.MP4")

    @pytest.mark.parametrize(
        ("args", "hint"),
        [
            (["-crf", "30"], "--crf"),
            (["-preset", "slow"], "--preset"),
            (["-c:v", "libx264"], "one codec"),
            (["-b:v", "1M"], "--bitrate"),
            (["-vf", "scale=640:-2"], "pipe ffmpeg"),
            (["-an"], "--no-audio"),
            (["-yt", "2"], "No such option"),
        ],
        ids=str,
    )
    def test_options_of_ffmpeg(self, cli: Runner, args: list[str], hint: str) -> None:
        assert hint in cli.fails(2, "gsvrenc", making.NOISE, *args, "q.gsvr")

    def test_missing_directory_fails(self, cli: Runner, tmp_path: Path) -> None:
        line = cli.fails(1, "gsvrenc", making.NOISE, tmp_path / "none" / "out.gsvr")
        assert "is not a directory" in line

    def test_refused_before_the_encoder_is_loaded(self, tmp_path: Path) -> None:
        code = f"""
import sys
from gsvrcodec.cli.enc import main
assert main([{str(making.NOISE)!r}, {str(tmp_path / "o.gsvr")!r}, "--crop", "500:500"]) == 2
assert "gsvrcodec.encoder.encode" not in sys.modules and "cv2" not in sys.modules
"""
        subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT, capture_output=True)


def test_warns_once(cli: Runner, tmp_path: Path) -> None:
    """The source is read several times, and its missing timestamps are repaired each time."""
    raw = making.raw_stream(tmp_path / "raw.h264")
    result = cli("gsvrenc", raw, tmp_path / "out.gsvr", *SMALL)
    assert result.code == 0, result.err
    assert result.err.count("gsvrenc: warning: ") == 1
