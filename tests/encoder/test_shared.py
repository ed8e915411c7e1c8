"""Pictures that are read from the source where they are wanted: any of them, exactly, or none."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from gsvrcodec.encoder.lookahead import checksum
from gsvrcodec.encoder.source import SharedPictures, SharedSource
from gsvrcodec.errors import InputError
from gsvrcodec.video import SourceFrame, VideoReader, open_video
from tests import making
from tests.video.sources import fields, h264


def frames_of(path: Path, **options: Any) -> list[SourceFrame]:
    with open_video(path, **options) as video:
        return list(video)


def shared(source: SharedSource, frames: list[SourceFrame]) -> SharedPictures:
    return SharedPictures(
        source, [frame.pts for frame in frames], [checksum(frame.rgb) for frame in frames]
    )


def read(path: Path, wanted: list[SourceFrame], **options: Any) -> NDArray[np.uint8]:
    """Read frames by what is known of them, in a source that has been pickled."""
    pictures = shared(SharedSource(str(path), options), wanted)
    found: SharedPictures = pickle.loads(pickle.dumps(pictures))
    assert len(found) == len(wanted)
    return found.unpacked()


def keyed(path: Path) -> Path:
    """Write H.264 with a key frame every six frames, and frames out of order."""
    return h264(path, {"g": "6", "bf": "2", "sc_threshold": "0"})


def refreshed(path: Path) -> Path:
    """Write H.264 without key frames but the first: parts of each picture are coded anew."""
    return h264(path, {"intra-refresh": "1", "g": "5", "bf": "0"})


class TestAnyFrames:
    @pytest.mark.parametrize(
        ("path", "options"),
        [
            (making.BUNNY_SMALL, {}),
            (making.BUNNY_SMALL, {"crop": (64, 48, 2, 3), "start_frame": 3, "frames": 15}),
            (making.TEN_BIT, {"start_seconds": 0.1}),
            (making.ODD, {}),
            (making.VFR_ROTATED, {"bake_rotation": True}),
        ],
        ids=str,
    )
    @pytest.mark.parametrize("first", [0, 3, 7])
    def test_of_a_real_clip(self, path: Path, options: dict[str, Any], first: int) -> None:
        frames = frames_of(path, **options)[first : first + 3]
        expected = [frame.rgb for frame in frames]
        np.testing.assert_array_equal(read(path, frames, **options), expected)

    @pytest.mark.parametrize(
        ("make", "options"),
        [
            (keyed, {}),
            (making.raw_stream, {"rate": 25}),
            (refreshed, {}),
            (fields, {"deinterlace": True}),
        ],
    )
    def test_of_other_kinds_of_film(
        self, tmp_path: Path, make: Callable[[Path], Path], options: dict[str, Any]
    ) -> None:
        path = make(tmp_path / ("a.264" if make is making.raw_stream else "a.mkv"))
        frames = frames_of(path, **options)
        for first in (0, 2, len(frames) - 2):
            found = read(path, frames[first : first + 2], **options)
            np.testing.assert_array_equal(found, [f.rgb for f in frames[first : first + 2]])

    def test_some_of_them(self) -> None:
        frames = frames_of(making.NOISE)[2::3]
        np.testing.assert_array_equal(read(making.NOISE, frames), [frame.rgb for frame in frames])

    def test_numbered_pictures(self, tmp_path: Path) -> None:
        pictures = [np.full((24, 32, 3), 20 * number, np.uint8) for number in range(6)]
        path = making.write_video(tmp_path / "in_%02d.png", pictures)
        found = read(path, frames_of(path, rate=5)[2:4], rate=5)
        np.testing.assert_array_equal(found, pictures[2:4])

    def test_reading_goes_on_where_it_was(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        starts: list[int | None] = []
        original = VideoReader.from_key

        def counted(video: VideoReader, pts: int | None) -> Any:
            starts.append(pts)
            return original(video, pts)

        monkeypatch.setattr(VideoReader, "from_key", counted)
        path = keyed(tmp_path / "a.mp4")
        frames, source = frames_of(path), SharedSource(str(path), {})
        for part in (frames[5:8], frames[8:12], frames[14:16]):
            found = shared(source, part).unpacked()
            np.testing.assert_array_equal(found, [frame.rgb for frame in part])
        assert starts == [frames[5].pts]
        np.testing.assert_array_equal(shared(source, frames[:1]).unpacked()[0], frames[0].rgb)
        assert len(starts) == 2


class TestRefused:
    def test_a_file_that_is_not_there(self, tmp_path: Path) -> None:
        frames = frames_of(making.NOISE)
        with pytest.raises(InputError, match=r"gone\.mp4 does not exist, as one of the workers"):
            read(tmp_path / "gone.mp4", frames)

    @pytest.mark.parametrize("change", ["one sample", "a timestamp", "one more frame"])
    def test_other_pictures(self, change: str) -> None:
        frames = frames_of(making.NOISE)
        found = shared(SharedSource(str(making.NOISE), {}), frames[4:7])
        pts, checksums = list(found.pts), list(found.checksums)
        if change == "one sample":
            frames[5].rgb[3, 4, 1] ^= 1
            checksums[1] = checksum(frames[5].rgb)
        elif change == "a timestamp":
            pts[2] += 1
        else:
            pts, checksums = [*pts, frames[-1].pts + 9], [*checksums, 0]
        with pytest.raises(InputError, match=r"has other pictures at .* where one of the workers"):
            SharedPictures(found.source, pts, checksums).unpacked()
