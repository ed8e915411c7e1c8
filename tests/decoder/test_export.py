"""From a .gsvr file to other formats: rates, speeds, parts, sizes, and work done ahead."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gsvrcodec
from gsvrcodec import Decoder
from gsvrcodec.decoder.export import DecodeResult
from gsvrcodec.decoder.schedule import SteadyRate, StoredFrames, schedule
from gsvrcodec.errors import CorruptError, LimitError, OutputError, UsageError
from gsvrcodec.video import SourceFrame, VideoReader, open_video
from gsvrcodec.video.plain import NullWriter
from tests import making

BASE = Fraction(1, 12800)
PLAYED = Fraction(1, 10), Fraction(58, 100)
PICTURE = np.zeros((2, 2, 3), np.uint8)


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twelve frames at 25 a second, from a tenth of a second on."""
    times = [(1280 + 512 * number, 512) for number in range(12)]
    path = tmp_path_factory.mktemp("transcode") / "a.gsvr"
    return making.gsvr_file(path, times=times, one_shot=True)


@pytest.fixture
def decoder(path: Path) -> Iterator[Decoder]:
    with gsvrcodec.open(path) as decoder:
        yield decoder


def written(
    path: Path, target: Path, **options: Any
) -> tuple[VideoReader, list[SourceFrame], DecodeResult]:
    """Decode to a lossless file and read that."""
    result = gsvrcodec.decode(path, target, **options)
    video = open_video(target)
    return video, list(video), result


class TestSchedule:
    def test_frames_as_they_are(self, decoder: Decoder) -> None:
        plan = schedule(decoder)
        assert plan == StoredFrames(range(12), *PLAYED, BASE, Fraction(25))
        assert [(picture.pts, picture.duration) for picture in plan.pictures(decoder)] == [
            (1280 + 512 * number, 512) for number in range(12)
        ]

    @pytest.mark.parametrize(
        ("part", "numbers"),
        [
            ({"start_frame": 4}, range(4, 12)),
            ({"start_frame": 4, "frames": 3}, range(4, 7)),
            ({"frames": 99}, range(12)),
            ({"start_seconds": 0}, range(12)),
            ({"start_seconds": Fraction(26, 100)}, range(4, 12)),
            ({"start_seconds": 0.26}, range(4, 12)),
            ({"start_seconds": 0.27}, range(5, 12)),
            ({"start_seconds": 0.26, "frames": 2}, range(4, 6)),
            ({"stop_seconds": 0.26}, range(4)),
            ({"stop_seconds": 0.27}, range(5)),
            ({"start_frame": 2, "stop_seconds": 0.26}, range(2, 4)),
            ({"start_seconds": 0.26, "stop_seconds": 0.34}, range(4, 6)),
            ({"stop_seconds": 99}, range(12)),
        ],
        ids=str,
    )
    def test_parts_are_half_open(
        self, decoder: Decoder, part: dict[str, Any], numbers: range
    ) -> None:
        plan = schedule(decoder, **part)
        assert isinstance(plan, StoredFrames)
        assert (plan.frames, plan.total, plan.first_frame) == (numbers, len(numbers), numbers[0])

    def test_bounds_of_a_part(self, decoder: Decoder) -> None:
        part = schedule(decoder, start_seconds=0.27, stop_seconds=0.39)
        assert (part.start, part.stop) == (Fraction(27, 100), Fraction(39, 100))
        part = schedule(decoder, start_frame=3, frames=4)
        assert (part.start, part.stop) == (Fraction(22, 100), Fraction(38, 100))
        part = schedule(decoder, start_frame=5, frames=7)
        assert (part.start, part.stop) == (Fraction(3, 10), Fraction(58, 100))
        part = schedule(decoder, fps=50)
        assert (part.start, part.stop) == PLAYED

    @pytest.mark.parametrize(
        ("options", "start", "stop", "total", "base"),
        [
            ({"fps": 25}, "1/10", "58/100", 12, "1/50"),
            ({"fps": 60}, "1/10", "58/100", 29, "1/60"),
            ({"fps": 59.94}, "1/10", "58/100", 29, "1/29970"),
            ({"fps": Fraction(60000, 1001)}, "1/10", "58/100", 29, "1/60000"),
            ({"fps": 0.5}, "1/10", "58/100", 1, "1/10"),
            ({"speed": 0.25}, "1/10", "58/100", 48, "1/25"),
            ({"speed": 2}, "1/10", "58/100", 6, "1/100"),
            ({"fps": 50, "speed": 0.5}, "1/10", "58/100", 48, "1/50"),
            ({"fps": 50, "start_frame": 2, "frames": 3}, "18/100", "30/100", 6, "1/50"),
            ({"fps": 50, "start_seconds": 0.2, "stop_seconds": 0.26}, "1/5", "26/100", 3, "1/50"),
            ({"fps": 50, "start_seconds": 0, "stop_seconds": 9}, "1/10", "58/100", 24, "1/50"),
            ({"fps": 50, "start_seconds": 0.56}, "14/25", "58/100", 1, "1/50"),
        ],
        ids=str,
    )
    def test_steady_rates(
        self,
        decoder: Decoder,
        options: dict[str, Any],
        start: str,
        stop: str,
        total: int,
        base: str,
    ) -> None:
        plan = schedule(decoder, **options)
        assert isinstance(plan, SteadyRate)
        assert (plan.start, plan.stop) == (Fraction(start), Fraction(stop))
        assert (plan.total, plan.time_base) == (total, Fraction(base))

    @pytest.mark.parametrize(
        ("options", "message"),
        [
            ({"start_frame": 1, "start_seconds": 0.2}, "`start_seconds` and `start_frame` exclude"),
            ({"frames": 1, "stop_seconds": 0.2}, "`stop_seconds` and `frames` exclude"),
            ({"start_frame": 12}, "the video has 12 frames"),
            ({"start_frame": -1}, "frame -1 is out of range"),
            ({"frames": 0}, "must be 1 or more, not 0"),
            ({"start_seconds": 0.58}, r"no frame starts .* 0\.1 s to 0\.58 s"),
            ({"start_seconds": 0.27, "stop_seconds": 0.29}, "no frame starts in this part"),
            ({"start_seconds": 0.3, "stop_seconds": 0.2}, "no frame starts in this part"),
            ({"start_seconds": 0.3, "stop_seconds": 0.3, "fps": 60}, "nothing is shown"),
            ({"start_seconds": 0.6, "fps": 60}, "nothing is shown"),
            ({"stop_seconds": 0.1, "fps": 60}, "nothing is shown"),
            ({"stop_seconds": float("nan")}, "must be finite, not nan"),
            ({"fps": 0}, "the frame rate must be over 0 and at most 1000, not 0"),
            ({"fps": 1e9}, "the frame rate must be over 0"),
            ({"fps": float("inf")}, "the frame rate must be over 0"),
            ({"speed": -1}, "the speed must be over 0"),
            ({"speed": 1e-9}, "the speed must be at least 1/100000"),
        ],
        ids=str,
    )
    def test_nonsense_fails(self, decoder: Decoder, options: dict[str, Any], message: str) -> None:
        with pytest.raises(UsageError, match=message):
            schedule(decoder, **options)


class TestRates:
    @pytest.mark.parametrize("suffix", [".mkv", ".mp4"])
    def test_frame_rate(self, path: Path, tmp_path: Path, decoder: Decoder, suffix: str) -> None:
        video, frames, result = written(path, tmp_path / f"out{suffix}", fps=50)
        assert result.frames == len(frames) == 24
        times = [frame.pts * video.info.time_base for frame in frames]
        assert times == [Fraction(1, 10) + Fraction(n, 50) for n in range(24)]
        if suffix == ".mkv":
            for number, frame in enumerate(frames):
                assert np.array_equal(frame.rgb, decoder.render(times[number]))
            assert np.array_equal(frames[6].rgb, decoder[3].data)

    def test_the_rate_of_the_source_gives_its_frames(
        self, path: Path, tmp_path: Path, decoder: Decoder
    ) -> None:
        _, frames, _ = written(path, tmp_path / "out.mkv", fps=25)
        assert [frame.rgb.tobytes() for frame in frames] == [f.data.tobytes() for f in decoder]

    def test_slow_motion(self, path: Path, tmp_path: Path, decoder: Decoder) -> None:
        video, frames, _ = written(path, tmp_path / "out.mkv", speed=0.25)
        assert [frame.pts * video.info.time_base for frame in frames] == [
            Fraction(4, 10) + Fraction(n, 25) for n in range(48)
        ]
        assert np.array_equal(frames[7].rgb, decoder.render(Fraction(10 + 7, 100)))

    def test_fast_motion(self, path: Path, tmp_path: Path, decoder: Decoder) -> None:
        _, frames, _ = written(path, tmp_path / "out.mkv", speed=3)
        assert [frame.rgb.tobytes() for frame in frames] == [
            decoder[number].data.tobytes() for number in (0, 3, 6, 9)
        ]

    def test_y4m_has_the_rate(self, path: Path, tmp_path: Path) -> None:
        gsvrcodec.decode(path, tmp_path / "out.y4m", fps=Fraction(60000, 1001))
        data = (tmp_path / "out.y4m").read_bytes()
        assert b" F60000:1001 " in data[:80]
        assert data.count(b"FRAME\n") == 29

    def test_pictures_count_from_0(self, path: Path, tmp_path: Path) -> None:
        gsvrcodec.decode(path, tmp_path / "o_%02d.png", fps=50, start_frame=10)
        assert sorted(p.name for p in tmp_path.iterdir()) == [f"o_{n:02}.png" for n in range(4)]


class TestSizes:
    @pytest.mark.parametrize(
        ("size", "pixels", "aspect"),
        [
            (2, (96, 64), Fraction(4, 3)),
            ((24, -1), (24, 16), Fraction(4, 3)),
            ((25, -2), (25, 16), Fraction(4, 3)),
            ((48, 64), (48, 64), Fraction(8, 3)),
            ((96, 32), (96, 32), Fraction(2, 3)),
        ],
        ids=str,
    )
    def test_shape_is_kept(
        self, tmp_path: Path, size: Any, pixels: tuple[int, int], aspect: Fraction
    ) -> None:
        path = making.gsvr_file(tmp_path / "a.gsvr", frames=(2,), sample_aspect=Fraction(4, 3))
        video, frames, _ = written(path, tmp_path / "out.mp4", size=size)
        assert (video.info.width, video.info.height) == pixels
        assert video.info.sample_aspect == aspect
        with gsvrcodec.open(path, size=size) as decoder:
            assert making.psnr(frames[1].rgb, decoder[1].data) > 20

    def test_layers(self, path: Path, tmp_path: Path) -> None:
        _, frames, _ = written(path, tmp_path / "out.mkv", layers="static", frames=1)
        with gsvrcodec.open(path, layers="static") as decoder:
            assert np.array_equal(frames[0].rgb, decoder[0].data)

    def test_over_the_limit_fails(self, path: Path, tmp_path: Path) -> None:
        with pytest.raises(LimitError, match="the width of the pictures is 48000"):
            gsvrcodec.decode(path, tmp_path / "out.mkv", size=1000.0)


class TestBitDepth:
    @pytest.mark.parametrize(
        ("name", "source", "asked", "expected"),
        [
            ("b.mp4", 10, None, "yuv420p10le"),
            ("b.mkv", 12, None, "gbrp10le"),
            ("b.y4m", 10, None, "yuv420p10le"),
            ("b.mp4", 8, None, "yuv420p"),
            ("b.mp4", 10, 8, "yuv420p"),
            ("b.mkv", 8, 10, "gbrp10le"),
            ("%d.png", 10, None, "rgb24"),
            ("%d.png", 10, 10, "rgb48be"),
        ],
    )
    def test_as_the_source_where_it_fits(
        self, tmp_path: Path, name: str, source: int, asked: int | None, expected: str
    ) -> None:
        path = making.gsvr_file(tmp_path / "a.gsvr", frames=[1], bit_depth=source)
        gsvrcodec.decode(path, tmp_path / name, bit_depth=asked)
        assert open_video(tmp_path / name.replace("%d", "0")).info.pixel_format == expected

    def test_ten_bits_are_finer_than_eight(self, tmp_path: Path) -> None:
        path = making.gsvr_file(tmp_path / "a.gsvr", frames=[1], bit_depth=10)
        with gsvrcodec.open(path) as decoder, gsvrcodec.open(path, bit_depth=None) as deep:
            eight, ten = decoder[0].data.astype(float), deep[0].data.astype(float)
        assert 0.2 < np.abs(eight / 255 - ten / 1023).max() * 255 < 0.7

    def test_other_depths_fail(self, tmp_path: Path, path: Path) -> None:
        with pytest.raises(UsageError, match="must be 8 or 10, not 12"):
            gsvrcodec.decode(path, tmp_path / "b.mkv", bit_depth=12)


class TestAhead:
    def test_few_large_pictures_in_memory(self, path: Path) -> None:
        with gsvrcodec.open(path) as small, gsvrcodec.open(path, size=(4000, -1)) as large:
            assert small.batch == 16
            assert large.batch == 1

    def test_no_thread_stays(self, path: Path) -> None:
        before = threading.active_count()
        gsvrcodec.decode(path, None, muxer="null")
        assert threading.active_count() == before

    @pytest.mark.parametrize("error", [OutputError("disk full"), KeyboardInterrupt()])
    def test_failing_writer(
        self, path: Path, monkeypatch: pytest.MonkeyPatch, error: BaseException
    ) -> None:
        def fail(*_: object) -> None:
            raise error

        before = threading.active_count()
        monkeypatch.setattr(NullWriter, "write", fail)
        with pytest.raises(type(error)):
            gsvrcodec.decode(path, None, muxer="null")
        assert threading.active_count() == before

    @pytest.mark.parametrize("options", [{}, {"fps": 50}], ids=str)
    def test_failing_decoder(self, tmp_path: Path, options: dict[str, Any]) -> None:
        path = making.gsvr_file(tmp_path / "a.gsvr")
        data = bytearray(path.read_bytes())
        data[len(data) // 2] ^= 1
        path.write_bytes(data)
        before = threading.active_count()
        with pytest.raises(CorruptError, match="chunk GOPD at byte"):
            gsvrcodec.decode(path, tmp_path / "out.mkv", **options)
        assert threading.active_count() == before
        assert list(tmp_path.iterdir()) == [path]
        result = gsvrcodec.decode(path, tmp_path / "out.mkv", keep_going=True, **options)
        assert not result.complete
        assert result.lost_frames == (7 if options else 3)
        assert result.frames == len(list(open_video(tmp_path / "out.mkv")))
