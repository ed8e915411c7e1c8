"""Encodes of frames from memory, of file objects and containers; and to memory."""

from __future__ import annotations

import io
import itertools
import os
import resource
import threading
from collections.abc import Iterator
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
import torch

import gsvrcodec
from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.encoder.encode import EncodeResult
from gsvrcodec.errors import InputError, NotAVideoError, OutputError, UsageError
from tests import making
from tests.making import Rgb

quick = partial(gsvrcodec.encode, preset="fastest")


def moving(count: int = 6, size: tuple[int, int] = (64, 48)) -> Rgb:
    """Return frames of a bright spot that moves, in colours that YCbCr 4:2:0 would not keep."""
    y, x = np.mgrid[: size[1], : size[0]]
    frames = []
    for number in range(count):
        spot = np.exp(-((x - 20 - 2 * number) ** 2 + (y - 24) ** 2) / 60)
        red = 255 * (x // 4 % 2)
        frames.append(np.stack([red, 200 * spot, 255 - red * spot], 2))
    return np.array(frames).round().astype(np.uint8)


FRAMES = moving()

#: A part of a clip.
SMALL = (64, 48, None, None)


@pytest.fixture(scope="module")
def expected() -> bytes:
    """The file that the frames come to."""
    return data_of(quick(FRAMES, fps=25))


def data_of(result: EncodeResult) -> bytes:
    assert result.data is not None
    assert result.path is None
    return result.data


def payloads(data: bytes) -> list[bytes]:
    """Return the content of each GOP, timestamps included."""
    reader = GsvrReader(data)
    return [reader.read_chunk(entry.chunk) for entry in reader.gops]


class TestFrames:
    def test_are_fitted_as_those_of_lossless_pictures(
        self, expected: bytes, tmp_path: Path
    ) -> None:
        making.write_video(tmp_path / "in_%04d.png", list(FRAMES), making.output_info(list(FRAMES)))
        pictures = quick(tmp_path / "in_%04d.png", rate=25)
        assert payloads(expected) == payloads(data_of(pictures))
        with gsvrcodec.open(expected) as ours, gsvrcodec.open(data_of(pictures)) as theirs:
            assert ours.metadata.colour == theirs.metadata.colour

    def test_are_fitted_as_those_of_lossless_video(self, expected: bytes, tmp_path: Path) -> None:
        making.write_video(tmp_path / "a.mkv", list(FRAMES))
        with av.open(tmp_path / "a.mkv") as container:
            decoded = quick(container.decode(video=0), fps=25)
        assert data_of(decoded) == expected
        with (
            gsvrcodec.open(expected) as ours,
            gsvrcodec.open(data_of(quick(tmp_path / "a.mkv"))) as theirs,
        ):
            np.testing.assert_array_equal(ours[:].data, theirs[:].data)
            np.testing.assert_array_equal(ours[:].pts_seconds, theirs[:].pts_seconds)

    @pytest.mark.parametrize(
        "frames",
        [
            torch.from_numpy(FRAMES),
            torch.from_numpy(FRAMES).float().div(255).requires_grad_(),
            FRAMES / 255,
            np.asfortranarray(FRAMES),
            list(torch.from_numpy(FRAMES)),
        ],
        ids=["tensor", "float32 tensor", "float64", "other order in memory", "list"],
    )
    def test_of_other_kinds_give_the_same_bytes(self, frames: Any, expected: bytes) -> None:
        assert data_of(quick(frames, fps="25")) == expected

    def test_of_a_generator_are_asked_for_once_and_not_kept(self, expected: bytes) -> None:
        alive: list[int] = []

        class Frame(np.ndarray[Any, Any]):
            def __del__(self) -> None:
                alive.remove(id(self))

        def generate() -> Iterator[Rgb]:
            for frame in FRAMES:
                own = frame.copy().view(Frame)
                alive.append(id(own))
                assert len(alive) <= 3
                yield own
                del own

        assert data_of(quick(generate(), fps=25)) == expected

    def test_after_the_part_are_not_asked_for(self, expected: bytes) -> None:
        numbers = itertools.count()
        endless = (FRAMES[number % 6] for number in numbers)
        assert payloads(data_of(quick(endless, fps=25, frames=6))) == payloads(expected)
        assert next(numbers) == 6
        assert quick(endless, fps=25, start_seconds=0.08, stop_seconds=0.16).frames == 2
        assert next(numbers) == 11

    @pytest.mark.parametrize(
        ("fps", "tick"), [("30000/1001", Fraction(1001, 30000)), (Fraction(1, 2), 2), (12.5, 0.08)]
    )
    def test_keep_their_rate(self, fps: Any, tick: Any) -> None:
        with gsvrcodec.open(data_of(quick(FRAMES[:2], fps=fps))) as decoder:
            assert decoder.metadata.time_base == Fraction(tick).limit_denominator(10**5)
            assert [(frame.pts, frame.duration) for frame in decoder] == [(0, 1), (1, 1)]

    @pytest.mark.parametrize("size", [(1, 1), (33, 17)])
    def test_of_any_size(self, size: tuple[int, int]) -> None:
        result = quick(moving(1, size), fps=25, verify=True)
        with gsvrcodec.open(data_of(result)) as decoder:
            assert decoder[0].data.shape == (size[1], size[0], 3)


class TestFiles:
    def test_bytes_and_file_objects(self) -> None:
        content = making.NOISE.read_bytes()
        expected = data_of(quick(making.NOISE, frames=1, crop=SMALL))
        assert data_of(quick(content, frames=1, crop=SMALL)) == expected
        file = io.BytesIO(content)
        file.seek(100)
        assert data_of(quick(file, frames=1, crop=SMALL)) == expected
        assert file.tell() == 100

    def test_containers(self) -> None:
        expected = data_of(quick(making.BUNNY_SMALL, frames=1, crop=SMALL))
        with av.open(making.BUNNY_SMALL) as container:
            next(container.decode(video=0))
            assert data_of(quick(container, frames=1, crop=SMALL)) == expected
        file = io.BytesIO(making.BUNNY_SMALL.read_bytes())
        with av.open(file, "r") as container:
            assert data_of(quick(container, frames=1, crop=SMALL)) == expected
            assert len(list(container.decode(video=0))) == 24
        with gsvrcodec.open(expected) as decoder:
            assert len(list(decoder.streams())) == 1


class TestTargets:
    def test_a_path(self, expected: bytes, tmp_path: Path) -> None:
        result = quick(FRAMES, tmp_path / "a.gsvr", fps=25)
        assert (result.path, result.data) == (tmp_path / "a.gsvr", None)
        assert (tmp_path / "a.gsvr").read_bytes() == expected
        assert list(tmp_path.iterdir()) == [tmp_path / "a.gsvr"]

    def test_a_file_object_is_written_where_it_stands(self, expected: bytes) -> None:
        file = io.BytesIO(b"before")
        file.seek(6)
        result = quick(FRAMES, file, fps=25, verify=True)
        assert file.getvalue() == b"before" + expected
        assert (result.path, result.data) == (None, None)
        assert "data" not in result.to_dict()
        assert result.to_dict()["path"] is None

    def test_a_file_object_that_cannot_seek_gets_a_stream(self) -> None:
        reading, writing = os.pipe()
        came: list[bytes] = []
        with os.fdopen(reading, "rb") as end, os.fdopen(writing, "wb") as file:
            thread = threading.Thread(target=lambda: came.append(end.read()))
            thread.start()
            quick(FRAMES, file, fps=25, gop=2, keyint=0)
            file.close()
            thread.join()
        with gsvrcodec.open(came[0]) as decoder:
            assert decoder.metadata.gops == 3
            assert len(decoder) == 6


def broken() -> Iterator[Rgb]:
    """Yield a frame and fail."""
    yield FRAMES[0]
    raise LookupError("no more")


class TestRefused:
    @pytest.mark.parametrize(
        ("frames", "message"),
        [
            (FRAMES[0], r"must have the shape \(F, H, W, 3\), not \(48, 64, 3\)$"),
            (FRAMES.transpose(0, 3, 1, 2), r"not \(6, 3, 48, 64\); `permute\(0, 2, 3, 1\)`"),
            (torch.zeros(2, 8, 8, 4), r"not \(2, 8, 8, 4\)"),
            ([FRAMES[0, 0]], r"frame 0 must have the shape \(H, W, 3\), not \(64, 3\)"),
            (np.zeros((1, 0, 8, 3), np.uint8), "frame 0 must have the shape"),
            (FRAMES.astype(np.int64), "frame 0 must be uint8, .* not int64"),
            (FRAMES > 9, "not bool"),
            (["a", "b"], "frame 0 must have the shape"),
            ([[[1, 2], [3]]], "neither an array nor a tensor"),
            ([FRAMES[0], FRAMES[1, :40]], "frame 1 is 64x40, the ones before are 64x48"),
            ([FRAMES[0] / 255, FRAMES[1] / 254], "frame 1 has values outside of 0 to 1"),
            (np.full((1, 8, 8, 3), np.nan), "or NaN"),
            (np.zeros((1, 70000, 1, 3), np.uint8), "frames of 1x70000 cannot be encoded"),
            (17, "not int"),
            (io.StringIO("a"), "must be binary"),
        ],
    )
    def test_frames(self, frames: Any, message: str, tmp_path: Path) -> None:
        target = tmp_path / "a.gsvr"
        target.write_bytes(b"old")
        fps = None if isinstance(frames, int | io.StringIO) else 25
        with pytest.raises(UsageError, match=message) as caught:
            quick(frames, target, fps=fps, overwrite=True)
        assert caught.value.exit_code == 2
        assert target.read_bytes() == b"old"
        assert list(tmp_path.iterdir()) == [target]

    @pytest.mark.parametrize("frames", [FRAMES[:0], [], iter(())])
    def test_no_frames(self, frames: Any) -> None:
        with pytest.raises(NotAVideoError, match="there are no frames"):
            quick(frames, fps=25)

    def test_nothing(self) -> None:
        with pytest.raises(NotAVideoError, match="is empty"):
            quick(b"")

    @pytest.mark.parametrize("fps", [0, -25, 1e-9, float("nan"), float("inf"), "fast", "1/0", 2000])
    def test_rates(self, fps: Any) -> None:
        with pytest.raises(UsageError, match=f"`fps` must be over 0 and at most 1000, not {fps}"):
            quick(FRAMES, fps=fps)

    def test_a_rate_that_is_missing_or_has_no_place(self) -> None:
        with pytest.raises(UsageError, match="frames from memory need `fps`"):
            quick(FRAMES)
        with pytest.raises(UsageError, match="`fps` is for frames from memory"):
            quick(making.NOISE, fps=25)
        with pytest.raises(UsageError, match="`rate` is for pictures"):
            quick(FRAMES, fps=25, rate=25)

    def test_a_container_without_a_file(self) -> None:
        with (
            av.open("testsrc=size=64x48", format="lavfi") as container,
            pytest.raises(UsageError, match=r"must be of a file.*`container.decode"),
        ):
            quick(container)
        with pytest.raises(InputError, match="does not exist"):
            quick("none.mp4")

    @pytest.mark.parametrize(
        "target", [17, io.StringIO(), io.BufferedReader(io.BytesIO())], ids=["int", "text", "read"]
    )
    def test_targets(self, target: Any) -> None:
        with pytest.raises(UsageError, match="`dst`"):
            quick(FRAMES, target, fps=25)

    def test_errors_of_a_generator_pass(self, tmp_path: Path) -> None:
        with pytest.raises(LookupError, match="no more"):
            quick(broken(), tmp_path / "a.gsvr", fps=25)
        assert not list(tmp_path.iterdir())

    def test_resuming(self, tmp_path: Path) -> None:
        with pytest.raises(UsageError, match="can be read again"):
            quick(FRAMES, tmp_path / "a.gsvr", fps=25, resume=True)

    def test_no_room_for_the_temporary_file(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "none"))
        with pytest.raises(OutputError, match="TMPDIR"):
            quick(FRAMES, fps=25)

    @pytest.mark.parametrize("count", [1, 20])
    def test_a_full_disk(self, count: int) -> None:
        limits = resource.getrlimit(resource.RLIMIT_FSIZE)
        noise = np.random.default_rng(0).integers(0, 256, (count, 240, 320, 3), np.uint8)
        resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, limits[1]))
        try:
            with pytest.raises(
                OutputError, match=r"cannot be copied to .*: file too large; TMPDIR"
            ):
                quick(noise, fps=25)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
