"""Points followed by optical flow, and the motion that a fit starts from."""

from __future__ import annotations

import numpy as np
import pytest

from gsvrcodec.fit.motion import FlowEstimator, Image, Tracker, flow_estimator
from tests.fit.synthetic import moving_texture, times

STILL = np.zeros((20, 30, 3), np.uint8)


def drift(forward: tuple[float, float]) -> FlowEstimator:
    """Return an estimator of a picture that moves evenly; frames are told apart by their level."""

    def estimate(first: Image, second: Image) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
        sign = 1 if first.mean() <= second.mean() else -1
        return np.full((*first.shape[:2], 2), sign * np.array(forward), np.float32)

    return estimate


def levels(frames: int) -> list[Image]:
    return [STILL + np.uint8(number) for number in range(frames)]


class TestFollow:
    def test_a_translation_both_ways(self) -> None:
        step = (2.0, -1.0)
        points = np.random.default_rng(0).uniform(0.3, 0.7, (50, 2)).astype(np.float32)
        tracker = Tracker(moving_texture(7, step), flow_estimator("dis"))
        tracks, trust = tracker.follow(3, points)
        assert tracks.shape == (7, 50, 2)
        np.testing.assert_array_equal(tracks[3], points)
        moved = (tracks - points) * (160, 120)
        expected = np.multiply.outer(np.arange(7) - 3, step)[:, None]
        np.testing.assert_allclose(np.median(moved - expected, axis=1), 0, atol=0.4)
        assert np.median(trust) == 1

    def test_points_may_leave_the_frame_and_are_trusted_less(self) -> None:
        points = np.array([[0, 0], [0.9, 0.9]], np.float32)
        tracks, trust = Tracker(levels(4), drift((15, 15))).follow(0, points)
        np.testing.assert_allclose(tracks[3] - points, np.tile([1.5, 2.25], (2, 1)), atol=1e-5)
        assert (trust[0] == 1).all()
        assert (np.diff(trust, axis=0) <= 0).all()
        assert (trust[3] < 0.5).all()

    @pytest.mark.parametrize("count", [1, 1023, 1024, 1025])
    def test_any_number_of_points(self, count: int) -> None:
        points = np.full((count, 2), 0.5, np.float32)
        tracks, trust = Tracker(levels(2), drift((3, -2))).follow(0, points)
        np.testing.assert_allclose(tracks[1] - points, np.tile([0.1, -0.1], (count, 1)), atol=1e-6)
        assert (trust == 1).all()

    def test_one_frame(self) -> None:
        points = np.array([[0.5, 0.5]], np.float32)
        tracks, _ = Tracker([STILL], drift((1, 1))).follow(0, points)
        np.testing.assert_array_equal(tracks, points[None])


class TestMotion:
    @pytest.mark.parametrize("frames", [2, 3, 7])
    def test_a_translation_becomes_the_linear_term(self, frames: int) -> None:
        points = np.random.default_rng(1).uniform(0.3, 0.7, (40, 2)).astype(np.float32)
        taus = times(frames)
        tracker = Tracker(moving_texture(frames, (2, -1)), flow_estimator("dis"))
        linear, quadratic = tracker.motion(taus, int(np.abs(taus).argmin()), points)
        # From tau -1 to 1 the picture moves (frames - 1) steps; a pixel is 2 / side.
        expected = (frames - 1) * np.array([2, -1]) / (160, 120)
        np.testing.assert_allclose(np.median(linear, axis=0), expected, atol=0.006)
        np.testing.assert_allclose(np.median(quadratic, axis=0), 0, atol=0.006)

    @pytest.mark.parametrize("taus", [[0.0], [-1, 1], [-1, -0.9999998, -0.9999997, 1]])
    @pytest.mark.parametrize("start", [0, -1])
    def test_uneven_times_stay_in_bounds(self, taus: list[float], start: int) -> None:
        points = np.full((5, 2), 0.5, np.float32)
        tracker = Tracker(levels(len(taus)), drift((3, -2)))
        motion = tracker.motion(np.array(taus, np.float32), start % len(taus), points)
        assert np.abs(motion).max() < 1
