"""Optical flow: known translations are found, and no size is too small."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from gsvrcodec.errors import UsageError
from gsvrcodec.fit.flow import FlowField, flow_estimator, motion_degree, resize, track
from tests.fit.scenes import moving_texture


def still(width: int, height: int) -> FlowField:
    return np.zeros((height, width, 2), np.float32)


class TestDis:
    @pytest.mark.parametrize("step", [(0, 0), (3, 0), (0, -2), (-4, 5)])
    def test_translation_is_recovered(self, step: tuple[int, int]) -> None:
        first, second = moving_texture(2, step)
        flow = flow_estimator("dis")(first, second)
        assert flow.shape == (120, 160, 2)
        assert flow.dtype == np.float32
        inside = flow[16:-16, 16:-16].reshape(-1, 2)
        np.testing.assert_allclose(np.median(inside, axis=0), step, atol=0.25)
        assert motion_degree(flow) == pytest.approx(np.hypot(*step), abs=0.5)

    @pytest.mark.parametrize("size", [(1, 1), (200, 1), (8, 40), (31, 31), (32, 32), (33, 47)])
    def test_tiny_frames(self, size: tuple[int, int]) -> None:
        first, second = moving_texture(2, (1, 0), size)
        flow = flow_estimator("dis")(first, second)
        assert flow.shape == (size[1], size[0], 2)
        assert np.isfinite(flow).all()

    def test_an_estimator_keeps_nothing_from_call_to_call(self) -> None:
        first, second = moving_texture(2, (2, 1))
        used = flow_estimator("dis")
        used(second, first)
        np.testing.assert_array_equal(used(first, second), flow_estimator("dis")(first, second))


class TestRaft:
    def test_without_torchvision_fails(self, monkeypatch: pytest.MonkeyPatch) -> None:
        for name in ("torchvision", "torchvision.models.optical_flow"):
            monkeypatch.setitem(sys.modules, name, None)
        with pytest.raises(UsageError, match=r"--flow raft needs torchvision.*--flow dis"):
            flow_estimator("raft")

    def test_encode_without_torchvision_leaves_nothing(
        self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
    ) -> None:
        import gsvrcodec
        from tests import making

        for name in ("torchvision", "torchvision.models.optical_flow"):
            monkeypatch.setitem(sys.modules, name, None)
        with pytest.raises(UsageError, match="torchvision"):
            gsvrcodec.encode(making.NOISE, tmp_path / "a.gsvr", flow="raft")
        assert not list(tmp_path.iterdir())


class TestTrack:
    def test_points_follow_a_translation_both_ways(self) -> None:
        step = (2.0, -1.0)
        frames = moving_texture(7, step)
        points = np.random.default_rng(0).uniform(0.3, 0.7, (50, 2)).astype(np.float32)
        tracks = track(list(frames), 3, points, flow_estimator("dis"))
        assert tracks.shape == (7, 50, 2)
        np.testing.assert_array_equal(tracks[3], points)
        moved = (tracks - points) * (160, 120)
        expected = np.multiply.outer(np.arange(7) - 3, step)[:, None]
        np.testing.assert_allclose(np.median(moved - expected, axis=1), 0, atol=0.4)

    def test_points_may_leave_the_frame(self) -> None:
        frames = [np.zeros((20, 30, 3), np.uint8)] * 4
        points = np.array([[0, 0], [0.999, 0.999]], np.float32)
        tracks = track(frames, 0, points, lambda first, _: still(30, 20) + 15)
        np.testing.assert_allclose(tracks[3] - points, np.tile([1.5, 2.25], (2, 1)), atol=1e-5)

    @pytest.mark.parametrize("count", [1, 1023, 1024, 1025])
    def test_any_number_of_points(self, count: int) -> None:
        points, shift = np.full((count, 2), 0.5, np.float32), np.array([3, -2], np.float32)
        frames = [np.zeros((20, 30, 3), np.uint8)] * 2
        tracks = track(frames, 0, points, lambda *_: still(30, 20) + shift)
        np.testing.assert_allclose(tracks[1] - points, np.tile([0.1, -0.1], (count, 1)), atol=1e-6)

    def test_one_frame(self) -> None:
        points = np.array([[0.5, 0.5]], np.float32)
        tracks = track([np.zeros((9, 9, 3), np.uint8)], 0, points, lambda *_: still(9, 9))
        np.testing.assert_array_equal(tracks, points[None])


class TestResize:
    def test_keeps_the_aspect(self) -> None:
        assert resize(np.zeros((720, 1280, 3), np.uint8), 180).shape == (180, 320, 3)
        assert resize(np.zeros((405, 1, 3), np.uint8), 180).shape == (180, 1, 3)

    def test_never_enlarges(self) -> None:
        image = np.zeros((120, 160, 3), np.uint8)
        assert resize(image, 180) is image
