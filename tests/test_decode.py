"""The decoder: any frame in any order, by number or by time, from sound and damaged files."""

from __future__ import annotations

import logging
import random
import shutil
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

import gsvrcodec
from gsvrcodec import Decoder, Frame, FrameBatch
from gsvrcodec.container.reader import GsvrReader
from gsvrcodec.errors import CorruptError, InputError, LimitError, NotGsvrError, UsageError
from gsvrcodec.gops import CACHED_GOPS
from gsvrcodec.limits import Limits
from gsvrcodec.model.layers import Layers
from gsvrcodec.model.pack import unpack_gop
from gsvrcodec.render import render_frames
from tests import making

#: A film of 20 frames in 7 GOPs, more than the decoder keeps, starting late and of varying rate.
GOPS = (5, 1, 4, 3, 2, 4, 1)
STEPS = [3040, 3040, 2920, 9000, 20920] * 4
TIMES = [(1000 + sum(STEPS[:n]), STEPS[n]) for n in range(20)]


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return making.gsvr_file(
        tmp_path_factory.mktemp("decode") / "a.gsvr",
        frames=GOPS,
        times=TIMES,
        time_base=Fraction(1, 90_000),
        settings={"seed": 7},
        rotation=90,
    )


@pytest.fixture
def decoder(path: Path) -> Iterator[Decoder]:
    with gsvrcodec.open(path) as decoder:
        yield decoder


@pytest.fixture(scope="module")
def sequence(path: Path) -> list[Frame]:
    with gsvrcodec.open(path) as decoder:
        return list(decoder)


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

    def test_few_gops_in_memory(self, decoder: Decoder) -> None:
        for _ in decoder:
            assert len(decoder._store._cache) <= CACHED_GOPS

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


class TestRender:
    """Between frames, GOP 0 has the frames 0 to 4 and GOP 1 the frame 5 alone."""

    def test_at_frames_is_the_frames(self, decoder: Decoder, sequence: list[Frame]) -> None:
        base = decoder.metadata.time_base
        for frame in sequence:
            assert np.array_equal(decoder.render(frame.pts * base), frame.data)
            assert np.array_equal(decoder.render(frame.pts_seconds), frame.data)

    def test_between_frames_moves(self, decoder: Decoder, sequence: list[Frame]) -> None:
        ticks = [1000, 1001, 1760, 2520, 3280, 4039, 4040]
        pictures = decoder.render_many([Fraction(tick, 90_000) for tick in ticks])
        assert np.array_equal(pictures[0], sequence[0].data)
        assert np.array_equal(pictures[-1], sequence[1].data)
        assert len({picture.tobytes() for picture in pictures[1:-1]}) == 5
        # Motion is smooth: the way to the next picture is never longer than the whole way.
        whole = making.psnr(sequence[0].data, sequence[1].data)
        steps = [making.psnr(a, b) for a, b in pairwise(pictures)]
        assert min(steps) > whole + 3

    def test_equals_the_model(self, path: Path, decoder: Decoder) -> None:
        with GsvrReader(path) as reader:
            content = unpack_gop(reader.read_gop(0), reader.header, Limits())
        # Half way from frame 1 at 4040 to frame 2 at 7080, in a GOP of 1000 to 19000 ticks.
        tau = np.array([2 * (5560 - 1000) / 18_000 - 1], np.float32)
        (expected,) = render_frames(content.gop, tau, (48, 32), (48, 32))
        assert np.array_equal(decoder.render(Fraction(5560, 90_000)), expected)

    def test_fades_from_gop_to_gop(self, tmp_path: Path) -> None:
        path = making.gsvr_file(tmp_path / "scene.gsvr", frames=(3, 2), one_scene=True)
        with gsvrcodec.open(path) as decoder:
            last, first = decoder[2], decoder[3]
            quarter = Fraction(3 * last.pts + first.pts, 4) * decoder.metadata.time_base
            mean = 0.75 * last.data + 0.25 * first.data
            assert np.abs(last.data - mean).max() > 10
            assert np.array_equal(decoder.render(quarter), np.floor(mean + 0.5))

    def test_another_scene_does_not_fade_in(self, decoder: Decoder, sequence: list[Frame]) -> None:
        for frame in (sequence[4], sequence[5]):
            late = Fraction(frame.pts + frame.duration - 1, 90_000)
            assert np.array_equal(decoder.render(late), frame.data)

    def test_rests_at_the_end(self, decoder: Decoder, sequence: list[Frame]) -> None:
        end = Fraction(sequence[19].pts + sequence[19].duration - 1, 90_000)
        assert np.array_equal(decoder.render(end), sequence[19].data)

    def test_many_in_any_order(self, decoder: Decoder) -> None:
        times = [0.8, 0.1, 0.1, 1.7, 0.30001, 0.3]
        batch = decoder.render_many(times)
        assert batch.shape == (6, 32, 48, 3)
        for picture, time in zip(batch, times, strict=True):
            assert np.array_equal(picture, decoder.render(time))
        assert decoder.render_many([]).shape == (0, 32, 48, 3)

    def test_streaming(self, decoder: Decoder) -> None:
        times = [Fraction(1000 + 317 * n, 90_000) for n in range(480)]
        for count, (number, picture) in enumerate(decoder.rendered(iter(times))):
            assert number == count
            assert len(decoder._store._cache) <= CACHED_GOPS
            if not number % 37:
                assert np.array_equal(picture, decoder.render(times[number]))
        assert count == 479

    @pytest.mark.parametrize("seconds", [0.0, 1.8, -1, Fraction(999, 90_000)])
    def test_nothing_shown_fails(self, decoder: Decoder, seconds: float) -> None:
        with pytest.raises(ValueError, match=r"runs from 0\.0111111 s to 1\.74"):
            decoder.render(seconds)


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


class TestSize:
    def test_of_every_picture(self, path: Path, sequence: list[Frame]) -> None:
        with gsvrcodec.open(path, size=(96, -1)) as large:
            assert large.size == (96, 64)
            assert large.metadata.width == 48
            assert large[3].data.shape == (64, 96, 3)
            assert next(iter(large)).data.shape == (64, 96, 3)
            assert large[2:5].data.shape == (3, 64, 96, 3)
            # It is the same scene: its means of two by two pixels are the small picture.
            means = large[3].data.reshape(32, 2, 48, 2, 3).mean((1, 3)).round().astype(np.uint8)
        assert making.psnr(means, sequence[3].data) > 30

    def test_of_one_picture(self, decoder: Decoder, sequence: list[Frame]) -> None:
        seconds = sequence[3].pts_seconds
        assert decoder.render(seconds, (24, 20)).shape == (20, 24, 3)
        assert decoder.render(seconds, 2.5).shape == (80, 120, 3)
        assert decoder.render_many([seconds] * 2, 0.5).shape == (2, 16, 24, 3)
        assert np.array_equal(decoder.render(seconds, (48, 32)), sequence[3].data)

    def test_nonsense_fails(self, path: Path, decoder: Decoder) -> None:
        with pytest.raises(UsageError, match="a scale must be"):
            decoder.render(0.1, 0)
        with pytest.raises(LimitError, match="GSVR_LIMIT_WIDTH"):
            gsvrcodec.open(path, size=1e6)


class TestLayers:
    def test_add_up(self, tmp_path: Path) -> None:
        path = making.gsvr_file(tmp_path / "a.gsvr", one_scene=True)
        pictures = []
        for name in get_args(Layers):
            with gsvrcodec.open(path, layers=name) as decoder:
                pictures.append(decoder[3].data.astype(int))
        whole, *parts = pictures
        inside = (parts[0] > 0) & (parts[1] > 0)
        assert parts[0].any()
        assert parts[1].any()
        inside &= whole < 255
        assert inside.mean() > 0.1
        assert np.abs(parts[0] + parts[1] - whole)[inside].max() <= 1

    def test_unknown_fails(self, path: Path) -> None:
        with pytest.raises(UsageError, match="one of all, dynamic, static, not 'moving'"):
            Decoder(path, layers="moving")  # type: ignore[arg-type]


class TestBitDepth:
    @pytest.mark.parametrize("bits", [10, 16])
    def test_finer_codes_of_the_same_picture(
        self, path: Path, sequence: list[Frame], bits: int
    ) -> None:
        with gsvrcodec.open(path, bit_depth=bits) as decoder:
            deep = decoder[3].data
            assert decoder.render(sequence[3].pts_seconds).tobytes() == deep.tobytes()
        assert deep.dtype == np.uint16
        white = 2**bits - 1
        assert deep.max() == white
        coarse = deep * (255 / white)
        assert np.abs(coarse - sequence[3].data).max() <= 0.5 + 255 / white
        assert len(np.unique(deep)) > 300

    def test_as_the_source(self, path: Path, tmp_path: Path) -> None:
        with gsvrcodec.open(path, bit_depth=None) as decoder:
            assert decoder.bit_depth == 8
        deep = making.gsvr_file(tmp_path / "deep.gsvr", frames=(2,), bit_depth=12)
        with gsvrcodec.open(deep, bit_depth=None) as decoder:
            assert decoder.bit_depth == 10
            assert decoder[0].data.max() == 1023

    def test_unknown_fails(self, path: Path) -> None:
        with pytest.raises(UsageError, match="8 to 16, not 7"):
            gsvrcodec.open(path, bit_depth=7)


class TestSharing:
    def test_threads(self, decoder: Decoder, sequence: list[Frame]) -> None:
        order = list(range(20)) * 5
        random.Random(2).shuffle(order)
        with ThreadPoolExecutor(8) as pool:
            for index, frame in zip(order, pool.map(decoder.get_frame_at, order), strict=True):
                assert_same(frame, sequence[index])

    def test_two_decoders(self, path: Path) -> None:
        with gsvrcodec.open(path) as one, gsvrcodec.open(path) as other:
            for a, b in zip(one, list(other), strict=True):
                assert_same(a, b)

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
        with pytest.raises(CorruptError, match="10 frames were found, which --keep-going decodes"):
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
