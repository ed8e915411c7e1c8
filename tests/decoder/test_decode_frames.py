"""The decoder: any frame in any order, by number or by time, from sound and damaged files."""

from __future__ import annotations

import logging
import random
import shutil
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

import gsvrcodec
from gsvrcodec import Decoder, Frame, FrameBatch
from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.decoder import gop_cache
from gsvrcodec.decoder.gop_cache import LEAST_CACHED_GOPS
from gsvrcodec.errors import CorruptError, InputError, LimitError, NotGsvrError
from tests import making
from tests.decoder.film import STEPS, TIMES


def assert_same(a: Frame, b: Frame) -> None:
    assert (a.index, a.pts, a.duration) == (b.index, b.pts, b.duration)
    assert (a.pts_seconds, a.duration_seconds) == (b.pts_seconds, b.duration_seconds)
    assert np.array_equal(a.data, b.data)


class TestMetadata:
    def test_of_the_file(self, path: Path, decoder: Decoder) -> None:
        meta = decoder.metadata
        assert (meta.width, meta.height, meta.rotation) == (48, 32, 90)
        assert (meta.frames, meta.gops, meta.gaussians) == (20, 7, 7 * 60)
        assert meta.begin_seconds == Fraction(1000, 90_000)
        assert meta.duration_seconds == Fraction(sum(STEPS), 90_000)
        assert meta.average_rate == 20 / meta.duration_seconds
        assert meta.size_bytes == path.stat().st_size
        assert meta.settings == {"seed": 7}
        assert len(decoder) == 20


class TestFrames:
    def test_sequence(self, sequence: list[Frame]) -> None:
        assert [frame.index for frame in sequence] == list(range(20))
        assert [(frame.pts, frame.duration) for frame in sequence] == TIMES
        assert all(frame.data.shape == (32, 48, 3) for frame in sequence)
        assert all(frame.data.dtype == np.uint8 for frame in sequence)
        assert len({frame.data.tobytes() for frame in sequence}) == 20
        assert sequence[3].pts_seconds == 10_000 / 90_000
        assert sequence[3].duration_seconds == 9_000 / 90_000

    def test_any_order_equals_the_sequence(self, decoder: Decoder, sequence: list[Frame]) -> None:
        order = list(range(20)) * 2 + [0, 19, 0, 19]
        random.Random(1).shuffle(order)
        for index in order:
            assert_same(decoder[index], sequence[index])
        batch = decoder.get_frames_at(order)
        for frame, index in zip(batch, order, strict=True):
            assert_same(frame, sequence[index])

    def test_backwards_and_negative(self, decoder: Decoder, sequence: list[Frame]) -> None:
        for index in range(-1, -21, -1):
            assert_same(decoder[index], sequence[index])
            assert_same(decoder.get_frame_at(index), sequence[index])

    def test_any_number_of_threads(self, path: Path, sequence: list[Frame]) -> None:
        for threads in (1, 3):
            with gsvrcodec.open(path, threads=threads) as decoder:
                assert_same(decoder[7], sequence[7])

    @pytest.mark.parametrize("index", [20, -21, 10**9])
    def test_out_of_range_fails(self, decoder: Decoder, index: int) -> None:
        with pytest.raises(IndexError, match=f"frame {index} of a video of 20 frames"):
            decoder[index]

    def test_gops_stay_in_memory(self, decoder: Decoder) -> None:
        first = decoder._gops.get(0)
        assert len(list(decoder)) == 20
        assert len(decoder._gops._cache) == 7
        assert decoder._gops.get(0) is first

    def test_few_large_gops_in_memory(self, path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(gop_cache, "CACHED_BYTES", 1)
        with gsvrcodec.open(path) as decoder:
            for _ in decoder:
                assert len(decoder._gops._cache) <= LEAST_CACHED_GOPS

    def test_range_while_streaming(self, decoder: Decoder, sequence: list[Frame]) -> None:
        part = list(decoder.frames(4, 11))
        assert [frame.index for frame in part] == list(range(4, 11))
        assert_same(part[-1], sequence[10])
        assert list(decoder.frames(20)) == []


class TestSlices:
    @pytest.mark.parametrize(
        "key",
        [
            slice(None),
            slice(3, 9),
            slice(None, None, 3),
            slice(None, None, -1),
            slice(-4, None),
            slice(5, 5),
            slice(18, 100),
        ],
        ids=str,
    )
    def test_as_of_a_list(self, decoder: Decoder, sequence: list[Frame], key: slice) -> None:
        batch, truth = decoder[key], sequence[key]
        assert isinstance(batch, FrameBatch)
        assert batch.data.shape == (len(truth), 32, 48, 3)
        assert len(batch) == len(truth)
        for frame, expected in zip(batch, truth, strict=True):
            assert_same(frame, expected)
        assert batch.pts_seconds.tolist() == [frame.pts_seconds for frame in truth]


class TestTimes:
    def test_played_at(self, decoder: Decoder, sequence: list[Frame]) -> None:
        for frame in sequence:
            late = frame.pts_seconds + frame.duration_seconds * 0.999
            assert decoder.get_frame_played_at(frame.pts_seconds).index == frame.index
            assert decoder.get_frame_played_at(late).index == frame.index

    @pytest.mark.parametrize("seconds", [-1.0, 0.0, 0.011, 1.8, 1e300])
    def test_nothing_played_fails(self, decoder: Decoder, seconds: float) -> None:
        with pytest.raises(ValueError, match=r"runs from 0\.0111111 s to 1\.74"):
            decoder.get_frame_played_at(seconds)

    @pytest.mark.parametrize("seconds", [float("nan"), float("inf")])
    def test_no_time_fails(self, decoder: Decoder, seconds: float) -> None:
        with pytest.raises(ValueError, match="must be finite"):
            decoder.get_frame_played_at(seconds)

    def test_played_in_range(self, decoder: Decoder, sequence: list[Frame]) -> None:
        seconds = [frame.pts_seconds for frame in sequence]
        end = float(decoder.metadata.end_seconds)

        def indices(start: float, stop: float) -> list[int]:
            return [frame.index for frame in decoder.get_frames_played_in_range(start, stop)]

        assert indices(seconds[0], end) == list(range(20))
        assert indices(seconds[3], seconds[8]) == [3, 4, 5, 6, 7]
        assert indices(seconds[3] + 0.01, seconds[8] + 0.001) == [3, 4, 5, 6, 7, 8]
        assert indices(seconds[5], seconds[5] + 1e-4) == [5]
        assert indices(seconds[5], seconds[5]) == []

    @pytest.mark.parametrize(("start", "stop"), [(1.0, 0.5), (0.5, 9.0), (0.0, 0.5)])
    def test_range_outside_fails(self, decoder: Decoder, start: float, stop: float) -> None:
        with pytest.raises(ValueError, match="the video runs from"):
            decoder.get_frames_played_in_range(start, stop)


class TestNumbersAndTimes:
    def test_when_frames_start(self, decoder: Decoder, sequence: list[Frame]) -> None:
        base = decoder.metadata.time_base
        for frame in sequence:
            assert decoder.starts_at(frame.index) == frame.pts * base
            assert decoder.first_frame_from(frame.pts * base) == frame.index
            assert decoder.first_frame_from(frame.pts_seconds) == frame.index
            assert decoder.first_frame_from(frame.pts_seconds + 1e-4) == frame.index + 1
        assert decoder.first_frame_from(-5) == 0
        assert decoder.first_frame_from(99) == 20
        with pytest.raises(IndexError):
            decoder.starts_at(20)


class TestSharing:
    def test_threads(self, decoder: Decoder, sequence: list[Frame]) -> None:
        order = list(range(20)) * 5
        random.Random(2).shuffle(order)
        with ThreadPoolExecutor(8) as pool:
            for index, frame in zip(order, pool.map(decoder.get_frame_at, order), strict=True):
                assert_same(frame, sequence[index])

    def test_two_decoders(self, path: Path, sequence: list[Frame]) -> None:
        with gsvrcodec.open(path) as one, gsvrcodec.open(path) as other:
            for a, b, truth in zip(one, other, sequence, strict=True):
                assert_same(a, truth)
                assert_same(b, truth)

    def test_iterators_do_not_disturb_each_other(
        self, decoder: Decoder, sequence: list[Frame]
    ) -> None:
        late = decoder.frames(11)
        for early, truth in zip(decoder.frames(), sequence, strict=True):
            assert_same(early, truth)
            if truth.index < 9:
                assert_same(next(late), sequence[11 + truth.index])
                assert_same(decoder[-1], sequence[19])

    def test_closed_while_iterating_fails(self, path: Path) -> None:
        with gsvrcodec.open(path) as decoder:
            frames = iter(decoder)
            next(frames)
        with pytest.raises(ValueError, match="the decoder is closed"):
            list(frames)

    def test_after_close_fails(self, path: Path) -> None:
        with gsvrcodec.open(path) as decoder:
            decoder[0]
        decoder.close()
        for use in (
            lambda: decoder[0],
            lambda: decoder[1:3],
            lambda: next(iter(decoder)),
            lambda: decoder.get_frame_played_at(0.1),
            lambda: decoder.get_frames_played_in_range(0.1, 0.2),
            lambda: decoder.render(0.1),
            lambda: next(decoder.rendered([0.1])),
        ):
            with pytest.raises(ValueError, match="the decoder is closed"):
                use()


class TestBadFiles:
    def test_missing_fails(self, tmp_path: Path) -> None:
        with pytest.raises(InputError):
            gsvrcodec.open(tmp_path / "none.gsvr")

    def test_video_fails(self) -> None:
        with pytest.raises(NotGsvrError, match=r"not a \.gsvr file"):
            gsvrcodec.open(making.NOISE)

    def test_limits_hold(self, path: Path) -> None:
        with pytest.raises(LimitError, match="the width"):
            gsvrcodec.open(path, limits=gsvrcodec.Limits(width=47))

    def test_cut_short(self, path: Path, tmp_path: Path, sequence: list[Frame]) -> None:
        with GsvrReader(path) as reader:
            middle = reader.gops[3].offset + 40
        cut = tmp_path / "cut.gsvr"
        cut.write_bytes(path.read_bytes()[:middle])
        with pytest.raises(
            CorruptError, match="10 frames were found, which `keep_going=True` decodes"
        ):
            gsvrcodec.open(cut)
        with gsvrcodec.open(cut, keep_going=True) as decoder:
            assert decoder.recovered
            assert decoder.warnings
            for frame, truth in zip(decoder, sequence[:10], strict=True):
                assert_same(frame, truth)
            assert decoder.lost_frames == 0

    def test_damage_stays_in_its_gop(
        self,
        path: Path,
        tmp_path: Path,
        sequence: list[Frame],
        caplog: pytest.LogCaptureFixture,
    ) -> None:
        with GsvrReader(path) as reader:
            entry = reader.gops[2]
        damaged = tmp_path / "damaged.gsvr"
        shutil.copy(path, damaged)
        with damaged.open("r+b") as file:
            file.seek(entry.chunk.payload_offset + entry.size // 2)
            byte = file.read(1)[0]
            file.seek(-1, 1)
            file.write(bytes([byte ^ 4]))
        with gsvrcodec.open(damaged) as decoder:
            assert_same(decoder[5], sequence[5])
            assert_same(decoder[10], sequence[10])
            with pytest.raises(CorruptError, match=f"chunk GOPD at byte {entry.offset}"):
                decoder[8]
            with pytest.raises(CorruptError):
                list(decoder)
        with (
            caplog.at_level(logging.WARNING),
            gsvrcodec.open(damaged, keep_going=True) as decoder,
        ):
            whole = [*range(6), *range(10, 20)]
            assert [frame.index for frame in decoder] == whole
            assert decoder.lost_frames == 4
            times = [Fraction(1000 + 300 * n, 90_000) for n in range(519)]
            # The damaged GOP's own, and those that fade into it from the last frame before.
            kept = [
                n for n in range(519) if not sequence[5].pts < 1000 + 300 * n < sequence[10].pts
            ]
            assert [number for number, _ in decoder.rendered(times)] == kept
            assert decoder.lost_frames == 4 + 519 - len(kept)
        assert "frames 6 to 9 are left out" in caplog.text
        assert "pictures from 0.4" in caplog.text
