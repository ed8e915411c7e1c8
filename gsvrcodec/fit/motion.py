"""Points followed through a GOP by optical flow, and the polynomial motion that fits them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from gsvrcodec.fit.flow import FlowEstimator, FlowField, Image, resize
from gsvrcodec.fit.tuned import TRACKS
from gsvrcodec.model.gop import Float32Array


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
        tracks, trust = self.follow(start, points)
        moved = 2.0 * (tracks - tracks[start])
        basis = np.stack([taus - taus[start], taus**2 - taus[start] ** 2], 1).astype(np.float64)
        products = (basis[:, :, None] * basis[:, None, :]).reshape(len(taus), 4)
        normal = (trust.T @ products).reshape(-1, 2, 2) + TRACKS.ridge * np.eye(2)
        right = np.einsum("fi,fn,fnk->nik", basis, trust, moved, optimize=True)
        solution = np.linalg.solve(normal, right).astype(np.float32)
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
