"""Timestamps: coding and normalised time."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gsvrcodec.bitstream.timing import pack_timing, unpack_timing
from gsvrcodec.errors import CorruptError
from gsvrcodec.model.time import Ticks, normalised_time, time_at

TICKS = st.integers(1, 2**40)


def ticks(*values: int) -> Ticks:
    return np.array(values, np.int64)


class TestTiming:
    @given(
        start=st.integers(-(2**60), 2**60),
        steps=st.lists(st.one_of(st.sampled_from([33, 34]), TICKS), max_size=40),
        data=st.data(),
    )
    def test_round_trip(self, start: int, steps: list[int], data: st.DataObject) -> None:
        pts = np.cumsum(ticks(start, *steps))
        size = len(pts)
        durations = ticks(*data.draw(st.lists(st.integers(0, 50), min_size=size, max_size=size)))
        coded = pack_timing(pts, durations)
        found_pts, found_durations, end = unpack_timing(b"##" + coded, 2, start, size)
        np.testing.assert_array_equal(found_pts, pts)
        np.testing.assert_array_equal(found_durations, durations)
        assert end == 2 + len(coded)

    def test_a_constant_rate_is_one_run(self) -> None:
        assert pack_timing(512 * np.arange(24), np.full(24, 512)) == b"\x18\x80\x04\x80\x04"

    @pytest.mark.parametrize(
        ("pts", "durations"),
        [(ticks(0, 0), ticks(1, 1)), (ticks(5, 4), ticks(1, 1)), (ticks(0), ticks(-1))],
    )
    def test_packing_what_does_not_increase_fails(self, pts: Ticks, durations: Ticks) -> None:
        with pytest.raises(ValueError, match="must increase"):
            pack_timing(pts, durations)

    @pytest.mark.parametrize(
        "data",
        [
            b"",
            b"\3\1",
            b"\0\1\1",
            b"\4\1\1",
            b"\3\0\1",
            b"\2\1\1",
            b"\x83\x00\1\1",
            b"\3" + b"\xff" * 9 + b"\1\1",
            b"\3" + b"\xff" * 8 + b"\x7f" + b"\1",
            b"\3\1" + b"\xff" * 8 + b"\x7f",
            b"\3" + b"\xff" * 8 + b"\x3f" + b"\1",
        ],
    )
    def test_a_bad_table_fails(self, data: bytes) -> None:
        with pytest.raises(CorruptError, match="tim"):
            unpack_timing(data, 0, 0, 3)

    def test_an_overflow_of_timestamps_fails(self) -> None:
        step = b"\xff" * 8 + b"\x3f"  # 2**62 - 1
        with pytest.raises(CorruptError, match="overflow"):
            unpack_timing(b"\3" + step + b"\0", 0, 2**60, 3)


class TestNormalisedTime:
    def test_one_frame_is_the_middle(self) -> None:
        assert normalised_time(ticks(77)).tolist() == [0]

    def test_follows_timestamps_not_frame_numbers(self) -> None:
        tau = normalised_time(ticks(-10, 0, 5, 30))
        assert tau.dtype == np.float32
        assert tau.tolist() == [-1, -0.5, -0.25, 1]

    @given(start=st.integers(-(2**61), 2**61), steps=st.lists(TICKS, min_size=1, max_size=20))
    def test_goes_from_minus_one_to_one(self, start: int, steps: list[int]) -> None:
        tau = normalised_time(np.cumsum(ticks(start, *steps)))
        assert tau[0] == -1
        assert tau[-1] == 1
        assert (np.diff(tau) >= 0).all()


class TestTimeAt:
    @given(steps=st.lists(TICKS, max_size=20), start=st.integers(-(2**60), 2**60))
    def test_of_a_frame_is_the_frames(self, steps: list[int], start: int) -> None:
        pts = np.cumsum(ticks(start, *steps))
        between = [time_at(pts, int(tick)) for tick in pts]
        assert between == normalised_time(pts).tolist()

    def test_between_frames_is_in_proportion(self) -> None:
        pts = ticks(100, 130, 200)
        assert time_at(pts, 150) == 0
        assert time_at(pts, Fraction(225, 2)) == -0.75
        assert time_at(pts, Fraction(400, 3)) == np.float32(-1 / 3)

    def test_rests_outside(self) -> None:
        pts = ticks(100, 200)
        assert time_at(pts, 99) == -1
        assert time_at(pts, Fraction(401, 2)) == 1
        assert time_at(ticks(5), 10**12) == 0
