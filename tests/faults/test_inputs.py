"""Fault 22: every odd input has one defined result."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import ClassVar

import av
import numpy as np
import pytest

import gsvrcodec
from tests import making
from tests.cli.tools import Runner
from tests.video.films import film

QUICK = ("--preset", "fastest", "--gaussians", "30", "--workers", "1", "--pack", "deflate")


@pytest.fixture
def cli(capsys: pytest.CaptureFixture[str]) -> Runner:
    return Runner(capsys)


def noise(count: int, width: int = 48, height: int = 32) -> list[making.Rgb]:
    return list(np.random.default_rng(0).integers(0, 256, (count, height, width, 3), np.uint8))


def clip(path: Path, pixel_format: str, codec: str = "ffv1", **fields: object) -> Path:
    """Write three frames in a pixel format, with fields of the encoder set."""
    with av.open(path, "w") as output:
        stream = output.add_stream(codec, rate=25)
        assert isinstance(stream, av.VideoStream)
        stream.width, stream.height, stream.pix_fmt = 48, 32, pixel_format
        for name, value in fields.items():
            setattr(stream.codec_context, name, value)
        for picture in noise(3):
            frame = av.VideoFrame.from_ndarray(picture, "rgb24").reformat(format=pixel_format)
            output.mux(stream.encode(frame))
        output.mux(stream.encode(None))
    return path


def y4m(count: int, width: int = 48, height: int = 32) -> Callable[[Path], Path]:
    return lambda path: making.write_video(path / "a.y4m", noise(count, width, height))


def truncated(path: Path) -> Path:
    """A Y4M file that ends within its fourth frame."""
    whole = making.write_video(path / "a.y4m", noise(6))
    data = whole.read_bytes()
    whole.write_bytes(data[: len(data) * 7 // 12])
    return whole


def wide_pixels(path: Path) -> Path:
    pictures = noise(2)
    info = replace(making.output_info(pictures), sample_aspect=Fraction(4, 3))
    return making.write_video(path / "a.y4m", pictures, info)


class TestAccepted:
    """Encoded, decoded, and as many frames as there were."""

    CASES: ClassVar[dict[str, tuple[Callable[[Path], Path], int, dict[str, object]]]] = {
        "1 frame": (y4m(1), 1, {}),
        "1x1": (y4m(2, 1, 1), 2, {"width": 1, "height": 1}),
        "1xN": (y4m(2, 1, 9), 2, {"width": 1, "height": 9}),
        "odd": (y4m(2, 33, 17), 2, {"width": 33, "height": 17}),
        "grey": (lambda path: clip(path / "a.mkv", "gray"), 3, {"bit_depth": 8}),
        "yuv422p10": (lambda path: clip(path / "a.mkv", "yuv422p10le"), 3, {"bit_depth": 10}),
        "full range": (lambda path: clip(path / "a.mkv", "yuvj420p", "mjpeg"), 3, {}),
        "variable rate and rotated": (lambda _: making.VFR_ROTATED, 16, {"rotation": 90}),
        "missing timestamps": (lambda path: making.raw_stream(path / "a.h264"), 24, {}),
        "non-zero start": (
            lambda path: film(path / "a.mkv", start=Fraction(2), sound_start=Fraction(2)),
            10,
            {"begin_seconds": Fraction(2)},
        ),
        "SAR 4:3": (
            wide_pixels,
            2,
            {"sample_aspect": Fraction(4, 3)},
        ),
        "sound longer than the video": (
            lambda path: film(path / "a.mkv", sound_seconds=Fraction(2)),
            10,
            {},
        ),
    }

    @pytest.mark.parametrize(("make", "frames", "facts"), CASES.values(), ids=CASES)
    def test_whole(
        self,
        cli: Runner,
        tmp_path: Path,
        make: Callable[[Path], Path],
        frames: int,
        facts: dict[str, object],
    ) -> None:
        result = cli("gsvrenc", make(tmp_path), tmp_path / "a.gsvr", *QUICK)
        assert result.code == 0, result.err
        with gsvrcodec.open(tmp_path / "a.gsvr") as decoder:
            assert len(decoder) == sum(1 for _ in decoder) == frames
            for name, value in facts.items():
                assert getattr(decoder.metadata, name) == value
        assert cli("gsvrdec", tmp_path / "a.gsvr", tmp_path / "b.y4m").code == 0

    @pytest.mark.parametrize(
        ("make", "frames", "says"),
        [
            (lambda path: clip(path / "a.mkv", "bgra"), 3, "gsvrenc: warning: .*transparen.*\n"),
            (truncated, 3, ""),
        ],
        ids=["RGBA", "truncated"],
    )
    def test_with_a_warning(
        self,
        cli: Runner,
        tmp_path: Path,
        make: Callable[[Path], Path],
        frames: int,
        says: str,
    ) -> None:
        result = cli("gsvrenc", make(tmp_path), tmp_path / "a.gsvr", *QUICK, "-q")
        assert result.code == 0, result.err
        assert re.fullmatch(says, result.err)
        with gsvrcodec.open(tmp_path / "a.gsvr") as decoder:
            assert len(decoder) == frames


class TestRefused:
    """Nothing is written, and the exit code says whose fault it is."""

    @pytest.mark.parametrize(
        ("make", "code", "says"),
        [
            (lambda path: making.zero_frames(path / "a.y4m"), 3, "no video frames"),
            (lambda path: making.audio_with_cover(path / "a.mp4"), 3, "no video stream"),
            (lambda path: clip(path / "a.mkv", "yuv420p", "mpeg2video", flags=2**29), 4, "interla"),
        ],
        ids=["0 frames", "cover art", "interlaced"],
    )
    def test_refused(
        self, cli: Runner, tmp_path: Path, make: Callable[[Path], Path], code: int, says: str
    ) -> None:
        line = cli.fails(code, "gsvrenc", make(tmp_path), tmp_path / "a.gsvr", *QUICK)
        assert says in line
        assert not (tmp_path / "a.gsvr").exists()
