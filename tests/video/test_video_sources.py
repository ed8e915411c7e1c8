"""Sources of all kinds: turned, mirrored, interlaced, transparent, piped, numbered pictures."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest

import gsvrcodec
from gsvrcodec.errors import InputError, NotAVideoError, UnsupportedError, UsageError
from gsvrcodec.report.compare import report
from gsvrcodec.video import open_video, rereadable
from tests import making
from tests.video.sources import fields, save

#: A picture of which no turn or mirror image looks like another.
PICTURE = np.zeros((24, 48, 3), np.uint8)
PICTURE[:8, :16] = 255, 0, 0
PICTURE[:8, 32:] = 0, 255, 0
PICTURE[16:, :16] = 0, 0, 255


class TestOrientation:
    @pytest.mark.parametrize("suffix", [".mp4", ".mkv"])
    @pytest.mark.parametrize("mirrored", [False, True])
    @pytest.mark.parametrize("rotation", [0, 90, 180, 270])
    def test_kept_or_baked(
        self, tmp_path: Path, suffix: str, rotation: int, mirrored: bool
    ) -> None:
        info = replace(
            making.output_info([PICTURE]),
            rotation=rotation,
            mirrored=mirrored,
            sample_aspect=Fraction(4, 3),
        )
        path = making.write_video(tmp_path / f"a{suffix}", [PICTURE], info)
        kept = open_video(path)
        assert (kept.info.rotation, kept.info.mirrored) == (rotation, mirrored)
        assert kept.info.sample_aspect == info.sample_aspect
        baked = open_video(path, bake_rotation=True)
        assert (baked.info.rotation, baked.info.mirrored) == (0, False)
        expected = PICTURE[:, ::-1] if mirrored else PICTURE
        expected = np.rot90(expected, -rotation // 90)
        assert (baked.info.height, baked.info.width) == expected.shape[:2]
        assert making.psnr(next(iter(baked)).rgb, expected) > 25
        aspect = info.sample_aspect if rotation in (0, 180) else 1 / info.sample_aspect
        assert baked.info.sample_aspect == aspect

    def test_a_crop_is_of_the_turned_picture(self) -> None:
        whole = next(iter(open_video(making.VFR_ROTATED, bake_rotation=True))).rgb
        video = open_video(making.VFR_ROTATED, crop=(100, 300, 7, 5), bake_rotation=True)
        assert whole.shape == (320, 240, 3)
        assert np.array_equal(next(iter(video)).rgb, whole[5:305, 7:107])

    def test_through_a_gsvr_file(self, tmp_path: Path) -> None:
        info = replace(making.output_info([PICTURE]), rotation=270, mirrored=True)
        source = making.write_video(tmp_path / "a.mp4", [PICTURE], info)
        options: dict[str, Any] = {"preset": "fastest", "gaussians": 50}
        gsvrcodec.encode(source, tmp_path / "a.gsvr", **options)
        gsvrcodec.decode(tmp_path / "a.gsvr", tmp_path / "b.mp4")
        again = open_video(tmp_path / "b.mp4").info
        assert (again.rotation, again.mirrored) == (270, True)
        result = gsvrcodec.encode(source, tmp_path / "c.gsvr", bake_rotation=True, **options)
        with gsvrcodec.open(tmp_path / "c.gsvr") as decoder:
            assert decoder[0].data.shape == (48, 24, 3)
            assert decoder.metadata.rotation == 0
        assert report(source, tmp_path / "c.gsvr").psnr_rgb == pytest.approx(result.psnr, abs=0.02)


class TestInterlaced:
    def test_refused(self, tmp_path: Path) -> None:
        with pytest.raises(UnsupportedError, match=r"is interlaced.*`deinterlace=True`"):
            open_video(fields(tmp_path / "a.mkv"))

    def test_deinterlaced(self, tmp_path: Path) -> None:
        frames = list(open_video(fields(tmp_path / "a.mkv"), deinterlace=True))
        assert [frame.pts for frame in frames] == [0, 40, 80, 120, 160, 200]
        for frame in frames[1:-1]:
            # The lines of one moment, without a comb.
            lines = frame.rgb[8:40].astype(int).mean(2)
            assert np.abs(np.diff(lines, axis=0)).mean() < 6

    def test_progressive_is_left_alone(self) -> None:
        plain = next(iter(open_video(making.NOISE))).rgb
        assert np.array_equal(next(iter(open_video(making.NOISE, deinterlace=True))).rgb, plain)


class TestWarnings:
    def test_alpha_is_dropped(self, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
        picture = np.dstack([PICTURE, np.full(PICTURE.shape[:2], 9, np.uint8)])
        path = save(tmp_path / "a.png", [picture], "png", "rgba")
        assert np.array_equal(next(iter(open_video(path))).rgb, PICTURE)
        assert caplog.text.count("transparency is dropped") == 1

    def test_further_videos(self, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
        path = tmp_path / "a.mkv"
        with av.open(str(path), "w") as file:
            streams = [file.add_stream("ffv1", rate=25) for _ in range(2)]
            for stream in streams:
                assert isinstance(stream, av.VideoStream)
                stream.width, stream.height, stream.pix_fmt = 48, 24, "bgr0"
            for stream in streams:
                frame = av.VideoFrame.from_ndarray(PICTURE, format="rgb24").reformat(format="bgr0")
                file.mux([*stream.encode(frame), *stream.encode(None)])
        open_video(path)
        assert "the first video stream is taken, 1 more left out" in caplog.text


@pytest.mark.parametrize(
    ("layout", "bits"),
    [
        *[(name, 8) for name in ("yuv410p", "yuv411p", "yuv422p", "yuv440p", "yuva420p", "bgra")],
        *[("yuv422p10le", 10), ("gbrp12le", 12), ("yuv420p16le", 16), ("gbrap16le", 16)],
    ],
)
def test_pixel_formats(tmp_path: Path, layout: str, bits: int) -> None:
    colour = np.array([40, 90, 200], np.uint8)
    picture = np.broadcast_to(colour, (32, 48, 3))
    path = save(
        tmp_path / "a.mkv", [np.ascontiguousarray(picture)], "ffv1", "rgb24", pix_fmt=layout
    )
    video = open_video(path)
    assert np.abs(next(iter(video)).rgb.astype(int) - colour).max() <= 3
    assert (video.info.bit_depth, video.info.pixel_format) == (bits, layout)


class TestSequence:
    def test_numbered_pictures(self, tmp_path: Path) -> None:
        for number in range(8, 12):
            save(tmp_path / f"p {number:03}.png", [PICTURE // 2 + number], "png", "rgb24")
        save(tmp_path / "p 7.png", [PICTURE], "png", "rgb24")  # of another pattern
        video = open_video(tmp_path / "p %03d.png", rate=30)
        frames = list(video)
        base = video.info.time_base
        assert [frame.pts * base for frame in frames] == [Fraction(n, 30) for n in range(4)]
        assert [int(frame.rgb.min()) for frame in frames] == [8, 9, 10, 11]

    def test_there_and_back(self, tmp_path: Path) -> None:
        for number in range(3):
            save(tmp_path / f"{number}.png", [PICTURE], "png", "rgb24")
        gsvrcodec.encode(
            tmp_path / "%d.png", tmp_path / "a.gsvr", preset="fastest", gaussians=50, rate=12.5
        )
        with gsvrcodec.open(tmp_path / "a.gsvr") as decoder:
            assert [frame.pts_seconds for frame in decoder] == [0.0, 0.08, 0.16]
        gsvrcodec.decode(tmp_path / "a.gsvr", tmp_path / "out_%d.png")
        assert len(list(open_video(tmp_path / "out_%d.png"))) == 3

    def test_a_gap_fails(self, tmp_path: Path) -> None:
        for number in (0, 1, 3):
            save(tmp_path / f"{number}.png", [PICTURE], "png", "rgb24")
        with pytest.raises(InputError, match=r"2\.png is missing, but there is 3\.png"):
            open_video(tmp_path / "%d.png")

    @pytest.mark.parametrize("name", ["%d.png", "none/%04d.png"])
    def test_nothing_fails(self, tmp_path: Path, name: str) -> None:
        with pytest.raises(InputError, match="does not exist"):
            open_video(tmp_path / name)

    def test_rate_of_a_raw_stream(self, tmp_path: Path) -> None:
        path = making.raw_stream(tmp_path / "a.264")
        video = open_video(path, rate=Fraction(30000, 1001), frames=3)
        times = [frame.pts * video.info.time_base for frame in video]
        assert times == pytest.approx([n * 1001 / 30000 for n in range(3)], abs=1e-5)

    def test_rate_of_a_film_fails(self) -> None:
        with pytest.raises(UsageError, match="has its own times"):
            open_video(making.NOISE, rate=30)

    @pytest.mark.parametrize("rate", [0, -1, float("nan"), 1e9])
    def test_nonsense_fails(self, rate: float) -> None:
        with pytest.raises(UsageError, match="the rate must be"):
            open_video(making.NOISE, rate=rate)


class TestPart:
    @pytest.mark.parametrize(
        ("start", "stop", "expected"),
        [
            (0.12, 0.28, range(3, 7)),
            (0.121, 0.281, range(4, 8)),
            (None, 0.04, range(1)),
            (0.92, None, range(23, 24)),
            (0, 100, range(24)),
        ],
    )
    def test_half_open_times(
        self, start: float | None, stop: float | None, expected: range
    ) -> None:
        video = open_video(making.BUNNY_SMALL, start_seconds=start, stop_seconds=stop)
        frames = list(video)
        assert [frame.pts for frame in frames] == [512 * number for number in expected]
        assert {frame.duration for frame in frames} == {512}

    def test_time_and_number(self) -> None:
        video = open_video(making.BUNNY_SMALL, start_seconds=0.2, frames=2)
        assert [frame.pts for frame in video] == [5 * 512, 6 * 512]
        video = open_video(making.BUNNY_SMALL, start_frame=3, stop_seconds=0.2)
        assert [frame.pts for frame in video] == [3 * 512, 4 * 512]

    @pytest.mark.parametrize(
        ("options", "message"),
        [
            ({"start_seconds": 1, "start_frame": 2}, "`start_seconds` and `start_frame` exclude"),
            ({"stop_seconds": 1, "frames": 2}, "`stop_seconds` and `frames` exclude"),
            (
                {"start_seconds": 2, "stop_seconds": 1.5},
                "`stop_seconds=1.5` is not after `start_seconds=2`",
            ),
            (
                {"start_seconds": 1, "stop_seconds": 1},
                "`stop_seconds=1` is not after `start_seconds=1`",
            ),
            ({"start_seconds": float("nan")}, "must be finite"),
        ],
    )
    def test_contradictions_fail(self, options: dict[str, Any], message: str) -> None:
        with pytest.raises(UsageError, match=message):
            open_video(making.BUNNY_SMALL, **options)

    def test_after_the_end_fails(self) -> None:
        with pytest.raises(UsageError, match=r"no frame starts in the chosen time: .* 24 frames"):
            list(open_video(making.BUNNY_SMALL, start_seconds=7))


class TestPipes:
    def test_standard_input(self, tmp_path: Path) -> None:
        y4m = making.write_video(tmp_path / "a.y4m", [PICTURE] * 3)
        command = "import sys; from gsvrcodec.cli.enc import main; sys.exit(main())"
        target = tmp_path / "a.gsvr"
        args = ["--preset", "fastest", "--gaussians", "30", "--threads", "1", "-", str(target)]
        with y4m.open("rb") as file:
            done = subprocess.run(
                [sys.executable, "-c", command, *args],
                stdin=file,
                capture_output=True,
                check=False,
                cwd=Path(gsvrcodec.__file__).parent.parent,
                env={**os.environ, "TMPDIR": str(tmp_path)},
            )
        assert done.returncode == 0, done.stderr
        with gsvrcodec.open(target) as decoder:
            assert len(decoder) == 3
        assert sorted(path.name for path in tmp_path.iterdir()) == ["a.gsvr", "a.y4m"]

    def test_named_pipe(self, tmp_path: Path) -> None:
        pipe = tmp_path / "pipe"
        os.mkfifo(pipe)
        writer = threading.Thread(target=pipe.write_bytes, args=(making.NOISE.read_bytes(),))
        writer.start()
        with rereadable(pipe) as path:
            assert len(list(open_video(path))) == 20
            assert len(list(open_video(path))) == 20
        writer.join()
        assert not path.exists()

    def test_empty_pipe_fails(self, tmp_path: Path) -> None:
        pipe = tmp_path / "pipe"
        os.mkfifo(pipe)
        writer = threading.Thread(target=pipe.write_bytes, args=(b"",))
        writer.start()
        with pytest.raises(NotAVideoError, match="nothing came"), rereadable(pipe):
            pass
        writer.join()

    def test_files_are_used_as_they_are(self) -> None:
        with rereadable(making.NOISE) as path:
            assert path == making.NOISE
        assert path.exists()
