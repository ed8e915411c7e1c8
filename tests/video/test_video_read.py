"""Reading: the frames that FFmpeg gives, their times, crops and ranges, and bad input."""

from __future__ import annotations

import hashlib
import itertools
import logging
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest

from gsvrcodec.bitstream.header import ColourInfo
from gsvrcodec.errors import InputError, NotAVideoError, UnsupportedError, UsageError
from gsvrcodec.video import open_video, probe
from tests import making
from tests.video.sources import h264

#: Of the 132 RGB frames one after another; the pictures that the NeRV family trains on.
BUNNY_SHA256 = "52126f0b88bddddb25abea5e135a998b93636fa15d94b5acb1f7eb6958fa4fc5"


class TestProbe:
    def test_constant_rate(self) -> None:
        info = probe(making.BUNNY)
        assert (info.width, info.height, info.frames) == (1280, 720, 132)
        assert (info.time_base, info.average_rate) == (Fraction(1, 12800), Fraction(25))
        assert (info.rotation, info.sample_aspect, info.bit_depth) == (0, Fraction(1), 8)
        assert (info.codec, info.pixel_format, info.interlaced) == ("h264", "yuv420p", False)
        assert info.colour == ColourInfo(primaries=2, transfer=2, matrix=2, full_range=False)

    def test_rotation_is_clockwise(self) -> None:
        assert probe(making.VFR_ROTATED).rotation == 90

    def test_ten_bits(self) -> None:
        assert probe(making.TEN_BIT).bit_depth == 10


class TestFrames:
    def test_bunny_equals_the_published_pictures(self) -> None:
        digest = hashlib.sha256()
        with open_video(making.BUNNY) as video:
            for frame in video:
                digest.update(frame.rgb.tobytes())
        assert digest.hexdigest() == BUNNY_SHA256

    @pytest.mark.parametrize(
        ("path", "frames", "shape"),
        [
            (making.BUNNY_SMALL, 24, (180, 320, 3)),
            (making.TEN_BIT, 12, (180, 320, 3)),
            (making.ODD, 24, (135, 241, 3)),
            (making.VFR_ROTATED, 16, (240, 320, 3)),
            (making.NOISE, 20, (120, 160, 3)),
        ],
        ids=lambda value: value.stem if isinstance(value, Path) else None,
    )
    def test_samples(self, path: Path, frames: int, shape: tuple[int, ...]) -> None:
        read = list(open_video(path))
        assert len(read) == frames
        assert all(frame.rgb.shape == shape and frame.rgb.dtype == np.uint8 for frame in read)
        assert all(a.pts + a.duration == b.pts for a, b in itertools.pairwise(read))

    def test_every_iteration_starts_anew(self) -> None:
        video = open_video(making.NOISE, frames=3)
        first = [frame.rgb.tobytes() for frame in video]
        assert [frame.rgb.tobytes() for frame in video] == first
        iterators = iter(video), iter(video)
        assert next(iterators[0]).rgb.tobytes() == next(iterators[1]).rgb.tobytes() == first[0]

    def test_variable_rate_times_are_exact(self) -> None:
        with av.open(making.VFR_ROTATED) as file:
            truth = [(frame.pts, frame.duration) for frame in file.decode(video=0)]
        read = [(frame.pts, frame.duration) for frame in open_video(making.VFR_ROTATED)]
        assert read == truth

    def test_closed_fails(self) -> None:
        with open_video(making.NOISE) as video:
            pass
        with pytest.raises(ValueError, match="closed"):
            iter(video)

    def test_size_change_fails(self, tmp_path: Path) -> None:
        pieces = [np.zeros((48, 64, 3), np.uint8), np.zeros((32, 64, 3), np.uint8)]
        names = [making.write_video(tmp_path / f"{n}.png", [p]) for n, p in enumerate(pieces)]
        joined = tmp_path / "joined.png"
        joined.write_bytes(b"".join(name.read_bytes() for name in names))
        with av.open(joined, format="png_pipe") as file:
            sizes = {(frame.width, frame.height) for frame in file.decode(video=0)}
        assert len(sizes) == 2
        with pytest.raises(UnsupportedError, match="changes from 64x48 to 64x32 at frame 1"):
            list(open_video(joined))


class TestRange:
    def test_half_open(self) -> None:
        whole = list(open_video(making.NOISE))
        part = list(open_video(making.NOISE, start_frame=5, frames=4))
        assert [frame.pts for frame in part] == [frame.pts for frame in whole[5:9]]
        assert [frame.duration for frame in part] == [frame.duration for frame in whole[5:9]]
        assert np.array_equal(part[0].rgb, whole[5].rgb)

    def test_more_than_there_are(self) -> None:
        assert len(list(open_video(making.NOISE, start_frame=18, frames=100))) == 2

    def test_start_past_the_end_fails(self) -> None:
        with pytest.raises(UsageError, match=r"frame 20 is past the end: .* has 20 frames"):
            open_video(making.NOISE, start_frame=20)

    def test_start_past_the_end_of_an_uncounted_file_fails(self) -> None:
        video = open_video(making.ODD, start_frame=24)
        with pytest.raises(UsageError, match=r"frame 24 is past the end: .* has 24 frames"):
            list(video)

    @pytest.mark.parametrize("arguments", [{"start_frame": -1}, {"frames": 0}, {"frames": -3}])
    def test_negative_fails(self, arguments: dict[str, Any]) -> None:
        with pytest.raises(UsageError, match="must be"):
            open_video(making.NOISE, **arguments)


class TestExpectedFrames:
    @pytest.mark.parametrize("path", [making.BUNNY_SMALL, making.ODD, making.TEN_BIT], ids=str)
    @pytest.mark.parametrize(
        "options",
        [
            {},
            {"start_frame": 5},
            {"start_frame": 5, "frames": 3},
            {"start_frame": 2, "frames": 30},
            {"start_seconds": 0.2},
            {"start_seconds": 0.1, "stop_seconds": 0.4},
            {"stop_seconds": 0.3},
            {"stop_seconds": 30.0},
        ],
        ids=str,
    )
    def test_they_come(self, path: Path, options: dict[str, Any]) -> None:
        video = open_video(path, **options)
        assert video.expected_frames is not None
        assert abs(video.expected_frames - len(list(video))) <= 1

    def test_a_raw_stream_does_not_tell(self, tmp_path: Path) -> None:
        assert open_video(making.raw_stream(tmp_path / "a.264")).expected_frames is None


class TestFromKey:
    def test_all_frames_from_a_key_frame_on(self, tmp_path: Path) -> None:
        path = h264(tmp_path / "a.mp4", {"g": "6", "sc_threshold": "0"})
        with open_video(path, start_frame=14, frames=3) as video:
            chosen = list(video)
            coming = list(video.from_key(chosen[0].pts))
        assert len(coming) == 8  # of 20, from the third key frame on
        for frame, (now, picture) in zip(chosen, coming[2:], strict=False):
            assert now == frame.pts
            np.testing.assert_array_equal(picture(), frame.rgb)

    def test_from_the_start(self) -> None:
        with open_video(making.NOISE, start_frame=7) as video:
            times = [now for now, _ in video.from_key(None)]
        assert times == [frame.pts for frame in open_video(making.NOISE)]


class TestCrop:
    def test_centre_is_the_default(self) -> None:
        whole = next(iter(open_video(making.BUNNY, frames=1))).rgb
        video = open_video(making.BUNNY, crop=(1280, 640, None, None), frames=1)
        assert (video.info.width, video.info.height) == (1280, 640)
        assert (video.info.source_width, video.info.source_height) == (1280, 720)
        assert np.array_equal(next(iter(video)).rgb, whole[40:680])

    def test_position(self) -> None:
        whole = next(iter(open_video(making.ODD, frames=1))).rgb
        cropped = next(iter(open_video(making.ODD, crop=(33, 21, 7, None), frames=1))).rgb
        assert np.array_equal(cropped, whole[57:78, 7:40])

    @pytest.mark.parametrize(
        ("crop", "message"),
        [
            ((4000, 100, None, None), "larger than"),
            ((100, 4000, None, None), "larger than"),
            ((100, 100, 100, None), "reaches outside"),
            ((100, 100, None, -1), "reaches outside"),
            ((0, 100, None, None), "no pixel"),
        ],
    )
    def test_outside_fails(
        self, crop: tuple[int, int, int | None, int | None], message: str
    ) -> None:
        with pytest.raises(UsageError, match=message):
            open_video(making.NOISE, crop=crop)


class TestBadInput:
    def test_missing_fails(self, tmp_path: Path) -> None:
        with pytest.raises(InputError, match="does not exist"):
            open_video(tmp_path / "none.mp4")

    def test_directory_fails(self, tmp_path: Path) -> None:
        with pytest.raises(InputError, match="is a directory"):
            open_video(tmp_path)

    @pytest.mark.parametrize("name", ["text.txt", "text.mp4", "text", "text.gsvr"])
    def test_text_fails(self, tmp_path: Path, name: str) -> None:
        path = tmp_path / name
        path.write_text("This is not a video.\n" * 50)
        with pytest.raises(NotAVideoError, match="is not a video"):
            open_video(path)

    def test_empty_fails(self, tmp_path: Path) -> None:
        path = tmp_path / "empty.mp4"
        path.touch()
        with pytest.raises(NotAVideoError, match="it is empty"):
            open_video(path)

    def test_gsvr_fails(self, tmp_path: Path) -> None:
        path = tmp_path / "a.gsvr"
        path.write_bytes(b"\x89GSV\r\n\x1a\n" + bytes(100))
        with pytest.raises(NotAVideoError, match=r"\.gsvr file already"):
            open_video(path)

    def test_audio_only_fails(self, tmp_path: Path) -> None:
        with pytest.raises(NotAVideoError, match="no video stream: it holds audio only"):
            open_video(making.audio_only(tmp_path / "a.wav"))

    def test_cover_art_fails(self, tmp_path: Path) -> None:
        with pytest.raises(NotAVideoError, match="no video stream: it holds audio only"):
            open_video(making.audio_with_cover(tmp_path / "a.m4a"))

    def test_zero_frames_fails(self, tmp_path: Path) -> None:
        with pytest.raises(NotAVideoError, match="no video frames"):
            open_video(making.zero_frames(tmp_path / "a.y4m"))

    def test_cut_short_gives_what_is_there(
        self, tmp_path: Path, caplog: pytest.LogCaptureFixture
    ) -> None:
        path = tmp_path / "cut.webm"
        path.write_bytes(making.ODD.read_bytes()[:60_000])
        with caplog.at_level(logging.WARNING):
            frames = list(open_video(path))
        assert 0 < len(frames) < 24
        assert f"{path} is cut short: 0.44 s of 0.96 s could be read" in caplog.text

    def test_cut_short_with_its_head_first(
        self, tmp_path: Path, caplog: pytest.LogCaptureFixture
    ) -> None:
        pictures = [
            np.random.default_rng(n).integers(0, 256, (32, 48, 3), np.uint8) for n in range(20)
        ]
        path = making.write_video(tmp_path / "a.mp4", pictures)
        list(open_video(path))
        assert not caplog.records
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
        assert 5 < len(list(open_video(path))) < 15
        assert "is cut short" in caplog.text

    def test_name_like_an_address(self, tmp_path: Path) -> None:
        path = tmp_path / "http:..%d 12:30 ü.mp4"
        path.write_bytes(making.NOISE.read_bytes())
        assert len(list(open_video(path))) == 20
