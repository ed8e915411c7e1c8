"""Pictures at any time, of any size, depth and layer."""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from numpy.typing import NDArray

import gsvrcodec
from gsvrcodec import Decoder, Frame
from gsvrcodec.bitstream.gop_payload import unpack_gop
from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.errors import LimitError, UsageError
from gsvrcodec.limits import Limits
from gsvrcodec.model.layers import Layers
from gsvrcodec.render import render_frames
from tests import making


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
        (expected,) = render_frames(content.new, tau, (48, 32), (48, 32))
        assert np.array_equal(decoder.render(Fraction(5560, 90_000)), expected)

    def test_fades_from_gop_to_gop(self, tmp_path: Path) -> None:
        path = making.gsvr_file(tmp_path / "shot.gsvr", frames=(3, 2), one_shot=True)
        with gsvrcodec.open(path) as decoder:
            last, first = decoder[2], decoder[3]
            quarter = Fraction(3 * last.pts + first.pts, 4) * decoder.metadata.time_base
            mean = 0.75 * last.data + 0.25 * first.data
            assert np.abs(last.data - mean).max() > 10
            assert np.array_equal(decoder.render(quarter), np.floor(mean + 0.5))

    def test_another_shot_does_not_fade_in(self, decoder: Decoder, sequence: list[Frame]) -> None:
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
            if not number % 37:
                assert np.array_equal(picture, decoder.render(times[number]))
        assert count == 479

    @pytest.mark.parametrize("seconds", [0.0, 1.8, -1, Fraction(999, 90_000)])
    def test_nothing_shown_fails(self, decoder: Decoder, seconds: float) -> None:
        with pytest.raises(ValueError, match=r"runs from 0\.0111111 s to 1\.74"):
            decoder.render(seconds)


class TestSize:
    def test_of_every_picture(self, path: Path, sequence: list[Frame]) -> None:
        with gsvrcodec.open(path, size=(96, -1)) as large:
            assert large.size == (96, 64)
            assert large.metadata.width == 48
            assert large[3].data.shape == (64, 96, 3)
            assert next(iter(large)).data.shape == (64, 96, 3)
            assert large[2:5].data.shape == (3, 64, 96, 3)
            # It is the same shot: its means of two by two pixels are the small picture.
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
    @staticmethod
    def pictures(path: Path) -> list[NDArray[np.int64]]:
        """One frame with all Gaussians, with those that move and with the others."""
        found = []
        for name in get_args(Layers):
            with gsvrcodec.open(path, layers=name) as decoder:
                found.append(decoder[3].data.astype(np.int64))
        return found

    def test_of_sums_add_up(self, tmp_path: Path) -> None:
        path = making.gsvr_file(tmp_path / "a.gsvr", one_shot=True, blending="sum")
        whole, *parts = self.pictures(path)
        inside = (parts[0] > 0) & (parts[1] > 0)
        assert parts[0].any()
        assert parts[1].any()
        inside &= whole < 255
        assert inside.mean() > 0.1
        assert np.abs(parts[0] + parts[1] - whole)[inside].max() <= 1

    def test_the_whole_of_means_lies_between_them(self, tmp_path: Path) -> None:
        path = making.gsvr_file(tmp_path / "a.gsvr", one_shot=True)
        whole, *parts = self.pictures(path)
        low, high = np.minimum(*parts), np.maximum(*parts)
        # Black may be the ground, or less than black, which weighs on the whole.
        inside = (low > 0) & (high < 255)
        assert inside.mean() > 0.1
        between = (whole >= low - 1) & (whole <= high + 1)
        assert between[inside].mean() > 0.99
        assert (np.abs(whole - low)[inside] > 5).mean() > 0.1
        assert (np.abs(whole - high)[inside] > 5).mean() > 0.1

    def test_unknown_fails(self, path: Path) -> None:
        with pytest.raises(UsageError, match="one of all, dynamic, static, not 'moving'"):
            gsvrcodec.open(path, layers="moving")  # type: ignore[arg-type]


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
