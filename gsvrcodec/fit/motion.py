"""Motion of the frames: optical flow, and points followed by it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from gsvrcodec.errors import UsageError
from gsvrcodec.fit.recipe import Flow
from gsvrcodec.fit.tuned import TRACKS
from gsvrcodec.model.gop import Float32Array

Image = NDArray[np.uint8]
FlowField = NDArray[np.float32]
#: From a frame and the next, both (H, W, 3) uint8, to displacement in pixels (H, W, 2).
FlowEstimator = Callable[[Image, Image], FlowField]


def resize(image: Image, height: int) -> Image:
    """Shrink to at most `height` rows, keeping the aspect; never enlarge."""
    rows, columns = image.shape[:2]
    if rows <= height:
        return image
    width = max(1, round(columns * height / rows))
    return np.asarray(cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA), np.uint8)


def flow_estimator(kind: Flow, *, near: bool = False) -> FlowEstimator:
    """Make an estimator: "dis" is OpenCV's, "raft" needs torchvision.

    Args:
        kind: which one.
        near: let "dis" follow small and fast things as near as it can in the same time, for the
            motion that Gaussians begin with. Otherwise its field is smooth, by which the thresholds
            of the analysis were found.

    Raises:
        UsageError: torchvision is not installed.
    """
    return _raft() if kind == "raft" else _dis(near)


# DIS needs a few of its patches across the frame; smaller frames count as still.
_DIS_MIN_SIDE = 32


def _dis(near: bool) -> FlowEstimator:
    estimator = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_FAST)
    if near:
        estimator.setFinestScale(TRACKS.finest_scale)
        estimator.setGradientDescentIterations(TRACKS.descents)
        estimator.setVariationalRefinementIterations(0)

    def estimate(first: Image, second: Image) -> FlowField:
        if min(first.shape[:2]) < _DIS_MIN_SIDE:
            return np.zeros((*first.shape[:2], 2), np.float32)
        grey = [cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in (first, second)]
        initial = np.zeros((*first.shape[:2], 2), np.float32)
        flow = np.asarray(estimator.calc(grey[0], grey[1], initial), np.float32)
        if not near:
            return flow
        # What is wrong by itself goes, edges of what moves stay.
        smooth = [cv2.medianBlur(part, TRACKS.median_px) for part in cv2.split(flow)]
        return np.asarray(cv2.merge(smooth), np.float32)

    return estimate


def _raft() -> FlowEstimator:
    try:
        from torchvision.models.optical_flow import Raft_Small_Weights, raft_small
    except ImportError as error:
        raise UsageError(
            "`flow='raft'` needs torchvision, which is not installed: install it, "
            "or use `flow='dis'`"
        ) from error
    import torch

    weights = Raft_Small_Weights.DEFAULT
    model = raft_small(weights=weights).eval()

    def estimate(first: Image, second: Image) -> FlowField:
        height, width = first.shape[:2]
        # RAFT works on multiples of 8, of at least 128 pixels.
        padded = [max(128, (side + 7) // 8 * 8) for side in (height, width)]
        batch = [
            torch.from_numpy(
                np.pad(
                    image,
                    ((0, padded[0] - height), (0, padded[1] - width), (0, 0)),
                    mode="edge",
                ).transpose(2, 0, 1)[None]
            )
            for image in (first, second)
        ]
        with torch.inference_mode():
            flow = model(*weights.transforms()(*batch))[-1][0]
        return np.asarray(flow[:, :height, :width].permute(1, 2, 0).contiguous(), np.float32)

    return estimate


def lengths(flow: FlowField) -> NDArray[np.float32]:
    """Length of each displacement, (H, W) pixels; the mean is the paper's "motion degree"."""
    return np.hypot(flow[..., 0], flow[..., 1])


#: Points that are followed at a time: their tracks take 200 bytes a frame.
_POINTS = 2**15


class Tracker:
    """Optical flow between neighbouring frames of a GOP, both ways, estimated once."""

    def __init__(
        self, frames: Sequence[Image] | NDArray[np.uint8], estimate: FlowEstimator
    ) -> None:
        """Estimate all flows.

        Args:
            frames: F images of one size.
            estimate: the flow estimator.
        """
        small = [resize(frame, TRACKS.flow_height) for frame in frames]
        self._size = np.array(small[0].shape[1::-1], np.float32)
        self._frames = len(small)
        self._forward = [estimate(first, second) for first, second in pairwise(small)]
        self._backward = [estimate(second, first) for first, second in pairwise(small)]

    def follow(self, start: int, points: Float32Array) -> tuple[Float32Array, Float32Array]:
        """Follow points of frame `start` through all frames by chained flow.

        Args:
            start: the frame the points are given in.
            points: (N, 2) x, y in [0, 1) of the frame.

        Returns:
            (F, N, 2) x, y in the same units, outside [0, 1) where a point leaves the frame; and
            (F, N) trust in them, from 1 down to 0.
        """
        tracks = np.empty((self._frames, *points.shape), np.float32)
        trust = np.ones((self._frames, len(points)), np.float32)
        tracks[start] = points
        for index in range(start, self._frames - 1):
            flows = self._forward[index], self._backward[index]
            tracks[index + 1], kept = self._step(tracks[index], *flows)
            trust[index + 1] = trust[index] * kept
        for index in range(start, 0, -1):
            flows = self._backward[index - 1], self._forward[index - 1]
            tracks[index - 1], kept = self._step(tracks[index], *flows)
            trust[index - 1] = trust[index] * kept
        return tracks, trust

    def _step(
        self, points: Float32Array, there: FlowField, back: FlowField
    ) -> tuple[Float32Array, Float32Array]:
        at = points * self._size - 0.5
        moved = _sample(there, at)
        returned = _sample(back, at + moved)
        miss = np.square(moved + returned).sum(axis=1)
        lengths = (np.square(moved) + np.square(returned)).sum(axis=1)
        after = points + moved / self._size
        kept = np.where(miss < TRACKS.miss_px2 + TRACKS.miss_share * lengths, 1.0, TRACKS.doubted)
        kept *= np.where(((after >= 0) & (after < 1)).all(axis=1), 1.0, TRACKS.doubted)
        return after, kept.astype(np.float32)

    def motion(
        self, taus: Float32Array, start: int, points: Float32Array
    ) -> tuple[Float32Array, Float32Array]:
        """Least-squares motion a1 tau + a2 tau^2 of points, each frame weighted by its trust.

        Args:
            taus: (F,) normalised times.
            start: the frame the points are given in.
            points: (N, 2) x, y in [0, 1) of the frame.

        Returns:
            a1 and a2, both (N, 2) in normalised units ([-1, 1] is the frame).
        """
        basis = np.stack([taus - taus[start], taus**2 - taus[start] ** 2], 1).astype(np.float64)
        products = (basis[:, :, None] * basis[:, None, :]).reshape(len(taus), 4)
        solution = np.empty((len(points), 2, 2), np.float32)
        for begin in range(0, len(points), _POINTS):
            part = slice(begin, begin + _POINTS)
            tracks, trust = self.follow(start, points[part])
            moved = 2.0 * (tracks - tracks[start])
            normal = (trust.T @ products).reshape(-1, 2, 2) + TRACKS.ridge * np.eye(2)
            right = np.einsum("fi,fn,fnk->nik", basis, trust, moved, optimize=True)
            solution[part] = np.linalg.solve(normal, right)
        return np.ascontiguousarray(solution[:, 0]), np.ascontiguousarray(solution[:, 1])


def _sample(flow: FlowField, at: FlowField) -> FlowField:
    """Bilinear samples of `flow` at pixel coordinates `at` (N, 2), border replicated."""
    # cv2.remap takes maps of fewer than 32768 rows or columns: fold the list of points.
    side = 1024
    rows = -(-len(at) // side)
    padded = np.zeros((rows * side, 2), np.float32)
    padded[: len(at)] = at
    maps = padded.reshape(rows, side, 2)
    out = cv2.remap(
        flow, maps[..., 0], maps[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    return np.asarray(out, np.float32).reshape(-1, 2)[: len(at)]
