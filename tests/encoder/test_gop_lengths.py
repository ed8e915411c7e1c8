"""Lengths of adaptive GOPs: bounds, and where one moving picture ceases to show their frames."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gsvrcodec.encoder.analysis import FrameStats, analyse
from gsvrcodec.encoder.gop_lengths import GopLimits, adaptive
from gsvrcodec.encoder.tuned import GOP_LENGTH, PATHS
from gsvrcodec.fit.footage import Frames
from gsvrcodec.fit.motion import flow_estimator
from tests.fit.synthetic import moving_texture

BOUNDS = GopLimits(4, 32)
PUBLISHED = replace(BOUNDS, price=None)


def lengths(frames: Frames, limits: GopLimits = BOUNDS, bits: float = 1.0) -> list[int]:
    return adaptive(list(analyse(frames, flow_estimator("dis"))), limits, bits)


def leaving(left: float, frames: int = 64, detail: float = 400.0) -> list[FrameStats]:
    """Frames of which a picture that moves leaves the more, the longer it has to last."""
    errors = [left * length for length in PATHS.lengths]
    return [
        FrameStats(1.0, not number, 20.0, detail, left=tuple(errors[: number // 8]))
        for number in range(frames)
    ]


def swaying(frames: int) -> Frames:
    """A texture that changes its direction every eight frames."""
    texture = moving_texture(1, (0, 0), (320, 180))[0]
    places = np.cumsum([3 if number // 8 % 2 else -3 for number in range(frames)])
    return np.stack([np.roll(texture, place, axis=1) for place in places])


class TestBounds:
    @pytest.mark.parametrize("price", [0.0, GOP_LENGTH.price, 1e6, None])
    @given(
        left=st.lists(st.floats(0, 500) | st.just(0.0), min_size=1, max_size=150),
        shortest=st.integers(1, 20),
        extra=st.integers(0, 30),
    )
    def test_they_are_kept(
        self, price: float | None, left: list[float], shortest: int, extra: int
    ) -> None:
        longest, count = shortest + extra, len(left)
        stats = [
            FrameStats(error, not number, 20.0, 400.0, left=(error,) * min(3, number // 2))
            for number, error in enumerate(left)
        ]
        found = adaptive(stats, GopLimits(shortest, longest, price), 1.0)
        assert sum(found) == count
        assert 1 <= min(found) <= max(found) <= longest
        if -(-count // longest) * shortest <= count:
            assert min(found) >= shortest

    def test_nothing_moves(self) -> None:
        assert max(lengths(moving_texture(1, (0, 0)).repeat(64, axis=0))) == 32
        assert adaptive([FrameStats(0.0, True)], BOUNDS, 1.0) == [1]


class TestPaths:
    def test_a_gop_ends_where_motion_changes(self) -> None:
        """The texture goes back and forth, which no polynomial of degree 2 follows."""
        found = lengths(swaying(48))
        ends = np.cumsum(found)
        assert len(found) == 6
        assert all(abs(end - 8 * number) <= 1 for number, end in enumerate(ends, 1))

    def test_even_motion_needs_no_other_gop(self) -> None:
        """However fast it is: by the motion that adds up there were several."""
        frames = moving_texture(32, (2, 0), (320, 180))
        assert lengths(frames) == [32]
        assert len(lengths(frames, PUBLISHED)) > 2

    def test_what_a_picture_leaves_makes_shorter_gops(self) -> None:
        counts = [len(adaptive(leaving(left), BOUNDS, 1.0)) for left in (0, 0.3, 1, 3, 10, 30)]
        assert counts == sorted(counts)
        assert counts[0] == 2
        assert counts[-1] > 8

    def test_dear_gops_are_longer(self) -> None:
        def count(bits: float = 1.0, detail: float = 400.0, price: float = 1.0) -> int:
            limits = replace(BOUNDS, price=price * GOP_LENGTH.price)
            return len(adaptive(leaving(6.0, detail=detail), limits, bits))

        usual = count()
        assert count(price=4.0) == count(bits=4.0) < usual < count(bits=0.25) == count(price=0.25)
        assert count(detail=2000.0) < usual < count(detail=100.0)


class TestByMotion:
    """As published: GOPs of about the same motion, as few as keep a bound."""

    def test_more_motion_makes_more_gops(self) -> None:
        def found(motion: float) -> list[int]:
            stats = [FrameStats(0.0, True), *[FrameStats(motion, False)] * 95]
            return adaptive(stats, PUBLISHED, 1.0)

        counts = [len(found(motion)) for motion in (0, 0.5, 1, 2, 4, 8)]
        assert counts == sorted(counts)
        assert found(0) == [32, 32, 32]
        assert counts[-1] > 6

    def test_gops_have_about_the_same_motion(self) -> None:
        stats = [FrameStats(4.0 if 30 <= number < 50 else 0.5, False) for number in range(80)]
        found = adaptive(stats, PUBLISHED, 1.0)
        ends = np.cumsum([0, *found]).tolist()
        filled = [
            sum(frame.motion for frame in stats[begin:end]) / GOP_LENGTH.motion
            + (end - begin) / PUBLISHED.longest
            for begin, end in pairwise(ends)
        ]
        assert max(filled) <= 1
        assert max(filled) - min(filled) < 0.25
