"""What one moving picture leaves of the frames of a GOP: the measure of GOP lengths."""

from __future__ import annotations

from collections import deque
from functools import cache
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from gsvrcodec.encoder.tuned import PATHS
from gsvrcodec.fit.motion import FlowField, Image
from gsvrcodec.model.gop import Float32Array

#: Frames / frames of a GOP for which a point is in the picture, where it never is.
_NEVER = 1e-9


class _Fit(NamedTuple):
    """How quadratic paths are found for GOPs of one length."""

    offsets: tuple[int, ...]  #: frames that are looked at, from the first of the GOP
    weights: NDArray[np.float64]  #: (M,) frames that each of them stands for / frames of the GOP
    #: (M, M) from where a point is in these frames to where a quadratic path has it
    projection: NDArray[np.float64]


class _Points:
    """Points of one frame, followed by optical flow through the later ones."""

    def __init__(self, height: int, width: int) -> None:
        y, x = (
            np.arange(min(PATHS.spacing, side) // 2, side, PATHS.spacing, dtype=np.float32)
            for side in (height, width)
        )
        self._frames = 0
        self._now = np.stack(np.meshgrid(x, y))
        self.places: dict[int, Float32Array] = {0: self._now}  #: (2, Y, X), by frames since then

    def follow(self, flow: FlowField) -> None:
        """Go on to the next frame."""
        self._frames += 1
        self._now = self._now + np.moveaxis(_at(flow, self._now), -1, 0)
        if self._frames in PATHS.looks:
            self.places[self._frames] = self._now


class Paths:
    """Quadratic paths through the frames of a shot.

    The Gaussians of a GOP keep their colours and move by a polynomial of degree 2. What they cannot
    show without further bits is the variance of the frames along such paths: other motion, and what
    turns, changes, comes or goes.
    """

    def __init__(self) -> None:
        self._frames = 0
        self._pictures: deque[NDArray[np.uint8]] = deque(maxlen=PATHS.lengths[-1])
        self._begun: deque[_Points] = deque(maxlen=PATHS.lengths[-1] // PATHS.grid)

    def add(self, image: Image, flow: FlowField | None) -> tuple[float, ...]:
        """Go on by a frame.

        Args:
            image: (H, W, 3).
            flow: (H, W, 2) from the frame before, px; None for the first frame.

        Returns:
            The variance along quadratic paths through the frames of a GOP that ends with this one,
            squared 8-bit codes, for each of `PATHS.lengths` that does not begin before the first
            frame; empty for most frames.
        """
        self._pictures.append(np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8))
        if flow is not None:
            for points in self._begun:
                points.follow(flow)
        if self._frames % PATHS.grid == 0:
            self._begun.append(_Points(*image.shape[:2]))
        self._frames += 1
        if self._frames % PATHS.grid:
            return ()
        return tuple(self._variance(n) for n in PATHS.lengths if n <= self._frames)

    def _variance(self, length: int) -> float:
        """Variance along quadratic paths through the last frames."""
        fit, begun = _fit(length), self._begun[-length // PATHS.grid]
        places = np.stack([begun.places[offset] for offset in fit.offsets])
        paths = np.tensordot(fit.projection, places, 1).astype(np.float32)
        pictures = (self._pictures[offset - length] for offset in fit.offsets)
        seen = np.stack([_at(*pair) for pair in zip(pictures, paths, strict=True)])
        sides = np.reshape(self._pictures[-1].shape[::-1], (2, 1, 1))
        inside = (np.abs(2 * paths + 1 - sides) <= sides).all(axis=1)
        weights = fit.weights[:, None, None] * inside
        mean = (weights * seen).sum(axis=0) / np.maximum(weights.sum(axis=0), _NEVER)
        squares = (weights * np.square(seen - mean)).sum() / max(weights.sum(), _NEVER)
        # As of a sample: noise alone has the same variance in GOPs of any length.
        return round(float(squares / (1 - np.square(fit.weights).sum())), 2)


@cache
def _fit(length: int) -> _Fit:
    """Fit by least squares, each frame weighted by those that it stands for."""
    offsets = np.array([look for look in (0, *PATHS.looks) if look < length])
    bounds = [0, *(offsets[1:] + offsets[:-1] + 1) / 2, length]
    weights = np.diff(bounds) / length
    powers = np.vander(2 * offsets / length - 1, 3)
    roots = np.sqrt(weights)[:, None]
    projection = powers @ np.linalg.pinv(powers * roots) * roots.T
    return _Fit(tuple(offsets.tolist()), weights, projection)


def _at(image: Image | FlowField, places: Float32Array) -> Float32Array:
    """Values of an image, (H, W, ...), at places (2, Y, X)."""
    values = cv2.remap(
        image, places[0], places[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    return np.asarray(values, np.float32)
