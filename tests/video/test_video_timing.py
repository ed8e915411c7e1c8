"""Timestamps that are missing or run backwards."""

from __future__ import annotations

import logging
from fractions import Fraction
from pathlib import Path

import pytest

from gsvrcodec.video import open_video
from gsvrcodec.video.timing import Timeline
from tests import making


class TestTimeline:
    def test_sound_times_are_kept(self, caplog: pytest.LogCaptureFixture) -> None:
        timeline = Timeline("a", Fraction(1, 1000), Fraction(25))
        assert [timeline.place(pts, 40) for pts in (-80, 7, 8, 500)] == [-80, 7, 8, 500]
        assert timeline.last_duration() == 40
        assert not caplog.records

    def test_missing_follow_by_duration(self, caplog: pytest.LogCaptureFixture) -> None:
        timeline = Timeline("a", Fraction(1, 1000), None)
        with caplog.at_level(logging.WARNING):
            placed = [timeline.place(None, 10), timeline.place(None, 0), timeline.place(None, 10)]
        assert placed == [0, 10, 50]  # 40 ms: 25 frames a second are assumed
        assert len(caplog.records) == 1
        assert "no timestamp" in caplog.text

    def test_backwards_are_moved(self, caplog: pytest.LogCaptureFixture) -> None:
        timeline = Timeline("a", Fraction(1, 25), Fraction(25))
        assert [timeline.place(pts, 1) for pts in (5, 5, 3, 20)] == [5, 6, 7, 20]
        assert "out of order" in caplog.text


def test_raw_stream_without_timestamps(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    raw = making.raw_stream(tmp_path / "raw.h264")
    frames = list(open_video(raw))
    info = open_video(raw).info
    assert len(frames) == 24
    assert {frame.duration * info.time_base for frame in frames} == {Fraction(1, 25)}
    assert "no timestamp" in caplog.text
