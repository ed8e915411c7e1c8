"""Start of a fit: Gaussians placed by content, moving with the optical flow."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import reduce
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from gsvrcodec.fit.footage import Footage, Frames, Picture
from gsvrcodec.fit.motion import FlowEstimator, Tracker
from gsvrcodec.fit.tuned import START, TRIPLANE
from gsvrcodec.model.attributes import gaussian_parameters, triplane_channels
from gsvrcodec.model.gop import TRIPLANE_CHANNELS, Float32Array, Gop, GridSize
from gsvrcodec.model.reconstruction import Blending
from gsvrcodec.render.backend import Backend

Number = TypeVar("Number", np.int16, np.float32)


def density(frames: Frames) -> NDArray[np.float64]:
    """Density of Gaussians over all frames: (H, W), sums to 1; high where detail is."""
    return _density(map(gradient, frames), START.gradient_share)


def density_over(frames: Frames, plate: Picture) -> NDArray[np.float64]:
    """Density of Gaussians in front of a plate, (H, W, 3): high where frames differ from it."""
    return _density((_differing(frame, plate) for frame in frames), START.differing_share)


def _density(details: Iterable[Float32Array], share: float) -> NDArray[np.float64]:
    total = reduce(np.add, details)
    detail: NDArray[np.float64] = np.asarray(cv2.boxFilter(total, -1, (5, 5)), np.float64)
    share *= bool(detail.any())
    return detail * (share / max(float(detail.sum()), 1e-12)) + (1.0 - share) / detail.size


def gradient(frame: NDArray[np.uint8]) -> Float32Array:
    """Differences across and down, (H, W): absolute, summed over the channels of (H, W, 3)."""
    across = cv2.Sobel(frame, cv2.CV_16S, 1, 0, ksize=1)
    down = cv2.Sobel(frame, cv2.CV_16S, 0, 1, ksize=1)
    both = np.add(np.abs(across, out=across), np.abs(down, out=down), out=across)
    return over_channels(both).astype(np.float32)


def _differing(frame: Picture, plate: Picture) -> Float32Array:
    """Absolute difference beyond noise, (H, W), summed over the channels."""
    differing = over_channels(cv2.absdiff(frame, plate).astype(np.float32))
    return np.asarray(np.maximum(differing - np.float32(START.plate_noise), 0))


def over_channels(values: NDArray[Number]) -> NDArray[Number]:
    """Sum of the channels of (H, W, 3), (H, W); quicker than `sum`, whose rows are too short."""
    return values[..., 0] + values[..., 1] + values[..., 2]


@dataclass(frozen=True, slots=True, eq=False)
class _Placed:
    """Gaussians put on pixels of one frame: N of them."""

    frame: NDArray[np.int64]  #: (N,) index of that frame
    pixels: NDArray[np.int64]  #: (N, 2) x, y there
    position: Float32Array  #: (N, 2) canonical
    sigma: Float32Array  #: (N,) px
    linear: Float32Array  #: (N, 2)
    quadratic: Float32Array  #: (N, 2)

    def __getitem__(self, chosen: NDArray[np.intp]) -> _Placed:
        return _Placed(*(getattr(self, name)[chosen] for name in self.__slots__))

    def __add__(self, other: _Placed) -> _Placed:
        return _Placed(
            *(np.concatenate([getattr(p, name) for p in (self, other)]) for name in self.__slots__)
        )


class _Start:
    """Places Gaussians in a GOP."""

    def __init__(
        self,
        footage: Footage,
        gaussians: int,
        grid: GridSize,
        tracker: Tracker | None,
        rng: np.random.Generator,
        backend: Backend,
    ) -> None:
        self._frames, self._taus, self._gaussians = footage.frames, footage.taus, gaussians
        self._backend, self._tracker, self._rng = backend, tracker, rng
        self._size = footage.size
        plate = backend.plate
        self._plate = None if plate is None else plate.shown()
        self._xy, self._xt, self._yt = tri_plane(grid, rng)

    def density(self, frames: Frames) -> NDArray[np.float64]:
        """Density of Gaussians over frames, (H, W)."""
        return density(frames) if self._plate is None else density_over(frames, self._plate)

    def place(
        self,
        index: int,
        weights: NDArray[np.float64],
        where: NDArray[np.float64],
        count: int,
    ) -> _Placed:
        """Place `count` Gaussians on frame `index` by `weights`, sized by the density `where`."""
        width = self._size[0]
        chosen = sample_pixels(weights.ravel(), count, self._rng)
        pixels = np.stack([chosen % width, chosen // width], 1)
        inside = (pixels + self._rng.uniform(0, 1, pixels.shape)) / self._size
        points = inside.astype(np.float32)
        linear, quadratic = np.zeros_like(points), np.zeros_like(points)
        if self._tracker is not None:
            linear, quadratic = self._tracker.motion(self._taus, index, points)
        tau = self._taus[index]
        sigma = START.spread / np.sqrt(self._gaussians * where.ravel()[chosen])
        return _Placed(
            frame=np.full(count, index),
            pixels=pixels,
            position=2 * points - 1 - linear * tau - quadratic * tau**2,
            sigma=np.clip(sigma, *START.sigma_range).astype(np.float32),
            linear=linear,
            quadratic=quadratic,
        )

    def uncovered(self, placed: _Placed, index: int) -> Float32Array:
        """Lack of coverage of frame `index` by `placed`, (H, W) in [0, 1]."""
        prepared, tau = self._backend.prepare(self.gop(placed)), float(self._taus[index])
        own = self._backend.over(None)
        weights = own.sums(prepared, tau, self._size, self._size)[..., 3]
        covered = cv2.boxFilter(weights, -1, 2 * (START.hole_px,))
        return np.clip(1 - covered / START.covered, 0, 1)

    def gop(self, placed: _Placed) -> Gop:
        """Round Gaussians in the colours of the pixels that they are placed on."""
        x, y = placed.pixels.T
        colour = self._frames[placed.frame, y, x] / np.float32(255)
        return Gop(
            position=placed.position,
            log_scale=np.log(np.stack([placed.sigma, placed.sigma], 1)),
            rotation=np.zeros_like(placed.sigma),
            colour=colour,
            log_opacity=np.zeros_like(placed.sigma),
            indicator=np.full_like(placed.sigma, START.indicator),
            linear=placed.linear,
            quadratic=placed.quadratic,
            xy=self._xy,
            xt=self._xt,
            yt=self._yt,
        )


def content_aware(
    footage: Footage,
    gaussians: int,
    grid: GridSize,
    estimate: FlowEstimator | None,
    rng: np.random.Generator,
    backend: Backend,
) -> Gop:
    """Start from the middle frame: more and smaller Gaussians where there is more detail.

    Areas that the middle frame does not show start from the first and the last frame, where the
    moving Gaussians of the others leave holes.

    Args:
        footage: frames to show.
        gaussians: N.
        grid: Gx, Gy, Gt of the tri-plane; zeros for none.
        estimate: flow that the Gaussians' polynomials are fitted to; None = at rest.
        rng: source of the sampling.
        backend: renders what is covered.
    """
    frames = footage.frames
    tracker = None if estimate is None else Tracker(frames, estimate)
    start = _Start(footage, gaussians, grid, tracker, rng, backend)
    where = start.density(frames)
    middle = int(np.abs(footage.taus).argmin())
    placed = start.place(middle, where, where, gaussians)
    for index in sorted({0, len(frames) - 1} - {middle}):
        here = start.density(frames[index : index + 1])
        needed = here * start.uncovered(placed, index)
        count = int(gaussians * min(needed.sum(), START.hole_share))
        if count:
            # In place of as many from the middle frame.
            from_middle = np.flatnonzero(placed.frame == middle)
            dropped = rng.choice(from_middle, count, replace=False)
            kept = np.delete(np.arange(gaussians), dropped)
            placed = placed[kept] + start.place(index, needed + 1e-15, here, count)
    return start.gop(placed)


def affordable(grid: GridSize, gaussians: int, blending: Blending) -> GridSize:
    """The tri-plane with fewer cells in space, where its numbers would be dear.

    Args:
        grid: Gx, Gy, Gt; zeros for none.
        gaussians: Gaussians that it moves, which are what else the bits are spent on.
        blending: how pictures are formed, which sets its channels.
    """
    gx, gy, gt = grid
    if not gx:
        return grid
    numbers = TRIPLANE.share * gaussian_parameters(blending) * gaussians
    most = numbers / triplane_channels(blending)
    # With s times the cells a side, a channel has s^2 plane + s lines numbers.
    plane, lines = gx * gy, gt * (gx + gy)
    side = (math.sqrt(lines**2 + 4 * plane * most) - lines) / (2 * plane)
    least = TRIPLANE.cells[0]
    gx, gy = (min(n, max(least, round(side * n))) for n in (gx, gy))
    return gx, gy, gt


def tri_plane(
    grid: GridSize, rng: np.random.Generator
) -> tuple[Float32Array, Float32Array, Float32Array]:
    """Return a tri-plane to begin with: faint noise in space, ones in time."""
    gx, gy, gt = grid
    return (
        rng.normal(0, START.plane_noise, (gy, gx, TRIPLANE_CHANNELS)).astype(np.float32),
        np.ones((gt, gx, TRIPLANE_CHANNELS), np.float32),
        np.ones((gt, gy, TRIPLANE_CHANNELS), np.float32),
    )


def sample_pixels(
    weights: NDArray[np.float64], count: int, rng: np.random.Generator
) -> NDArray[np.int64]:
    """Pick `count` pixels by weight; without replacement as long as there are enough."""
    whole, rest = divmod(count, len(weights))
    repeats = [np.arange(len(weights))] * whole
    # The largest log(u)/w are a sample without replacement (Efraimidis and Spirakis).
    keys = np.log(rng.random(len(weights))) / weights
    return np.concatenate([*repeats, np.argpartition(-keys, max(rest - 1, 0))[:rest]])
