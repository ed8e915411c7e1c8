"""Cutting into GOPs: shot cuts of real clips, and lengths that keep what was asked."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from gsvrcodec.encoder.analysis import FrameStats, analyse
from gsvrcodec.encoder.slicing import slice_gops
from gsvrcodec.fit.flow import flow_estimator
from tests import making
from tests.fit.synthetic import FRAMES, moving_texture, sample

STEPS = st.lists(
    st.builds(
        FrameStats, st.floats(0, 60) | st.just(0.0), st.integers(0, 30).map(lambda n: n == 0)
    ),
    min_size=1,
    max_size=150,
)


def shots(steps: list[FrameStats]) -> list[int]:
    """Return the length of each shot."""
    starts = [n for n, step in enumerate(steps) if step.cut or n == 0]
    return [stop - start for start, stop in pairwise([*starts, len(steps)])]


def by_background(gops: list[range], steps: list[FrameStats]) -> Iterator[list[int]]:
    """Yield the lengths of each shot's GOPs, which cover it exactly."""
    rest = iter(gops)
    start = 0
    for length in shots(steps):
        lengths: list[int] = []
        while sum(lengths) < length:
            gop = next(rest)
            assert gop.start == start + sum(lengths)
            assert gop.step == 1
            assert len(gop) > 0
            lengths.append(len(gop))
        assert sum(lengths) == length, "a GOP spans a cut"
        yield lengths
        start += length
    assert not list(rest)


class TestAnalyse:
    @pytest.mark.parametrize("path", FRAMES, ids=lambda path: path.stem)
    def test_cuts_of_real_clips(self, path: Path) -> None:
        steps = list(analyse(sample(path), flow_estimator("dis")))
        assert len(steps) == FRAMES[path]
        cuts = [number for number, step in enumerate(steps) if step.cut]
        assert cuts == ([0, 12] if path == making.ODD else [0])
        assert all(step.motion == 0 for step in steps if step.cut)
        assert any(step.motion > 0 for step in steps)

    def test_motion_does_not_depend_on_resolution(self) -> None:
        small = list(analyse(moving_texture(3, (2, 0), (320, 180)), flow_estimator("dis")))
        doubled = moving_texture(3, (2, 0), (320, 180)).repeat(2, axis=1).repeat(2, axis=2)
        large = list(analyse(doubled, flow_estimator("dis")))
        assert [step.motion for step in large] == pytest.approx([step.motion for step in small])

    def test_a_still_picture_does_not_move(self) -> None:
        picture = moving_texture(1, (0, 0))[0]
        steps = list(analyse([picture] * 4, flow_estimator("dis")))
        assert [step.cut for step in steps] == [True, False, False, False]
        assert max(step.motion for step in steps) < 0.05

    def test_no_frames(self) -> None:
        assert list(analyse([], flow_estimator("dis"))) == []


class TestSliceGops:
    @given(steps=STEPS, gop=st.integers(1, 40))
    def test_fixed_length(self, steps: list[FrameStats], gop: int) -> None:
        for lengths in by_background(slice_gops(steps, gop, minimum=1, maximum=1), steps):
            assert set(lengths[:-1]) <= {gop}
            assert lengths[-1] <= gop

    # Motion at the start must not leave the end with fewer than the minimum.
    @example(steps=[FrameStats(60.0 * (n < 4), False) for n in range(11)], minimum=3, extra=1)
    @given(steps=STEPS, minimum=st.integers(1, 20), extra=st.integers(0, 30))
    def test_adaptive_length(self, steps: list[FrameStats], minimum: int, extra: int) -> None:
        maximum = minimum + extra
        gops = slice_gops(steps, "adaptive", minimum=minimum, maximum=maximum)
        for lengths, frames in zip(by_background(gops, steps), shots(steps), strict=True):
            assert max(lengths) <= maximum
            fewest = -(-frames // maximum)
            if fewest * minimum <= frames:
                assert min(lengths) >= minimum

    def test_more_motion_makes_more_gops(self) -> None:
        def gops(motion: float) -> int:
            steps = [FrameStats(0.0, True), *[FrameStats(motion, False)] * 95]
            return len(slice_gops(steps, "adaptive", minimum=4, maximum=32))

        counts = [gops(motion) for motion in (0, 0.5, 1, 2, 4, 8)]
        assert counts == sorted(counts)
        assert counts[0] == 3
        assert counts[-1] > 6

    def test_no_frames(self) -> None:
        assert slice_gops([], "adaptive", minimum=12, maximum=32) == []
