"""Where a fit starts: Gaussians placed by content, moving with the optical flow."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from gsvrcodec.fit.flow import FlowEstimator, resize, track
from gsvrcodec.model.gop import TRIPLANE_CHANNELS, Float32Array, Gop
from gsvrcodec.render.native import render_weights
from gsvrcodec.render.order import tile_order

Frames = NDArray[np.uint8]

_FLOW_HEIGHT = 360
#: Share of the Gaussians spread by gradient, the others evenly.
_GRADIENT_SHARE = 0.7
_SIGMA_RANGE = (0.6, 20.0)
_INITIAL_ALPHA = 0.88
_PLANE_NOISE = 0.01
#: Directions of the motion fit that the frame times hardly fix are left at rest.
_LEAST_CONDITION = 0.01


def density(frames: Frames) -> NDArray[np.float64]:
    """Where detail is, over all frames: (H, W), sums to 1."""
    total = np.zeros(frames.shape[1:3], np.float32)
    for frame in frames:
        dx = cv2.Sobel(frame, cv2.CV_32F, 1, 0, ksize=1)
        dy = cv2.Sobel(frame, cv2.CV_32F, 0, 1, ksize=1)
        total += (np.abs(dx) + np.abs(dy)).sum(axis=2)
    detail: NDArray[np.float64] = np.asarray(cv2.boxFilter(total, -1, (5, 5)), np.float64)
    even = 1.0 / detail.size
    share = _GRADIENT_SHARE if detail.any() else 0.0
    return detail * (share / max(float(detail.sum()), 1e-12)) + (1.0 - share) * even


def content_aware(
    frames: Frames,
    taus: Float32Array,
    gaussians: int,
    grid: tuple[int, int, int],
    estimate: FlowEstimator | None,
    rng: np.random.Generator,
) -> Gop:
    """Start from the middle frame: more and smaller Gaussians where there is more detail.

    Args:
        frames: (F, H, W, 3) uint8 of the GOP.
        taus: (F,) normalised times.
        gaussians: N.
        grid: Gx, Gy, Gt of the tri-plane; zeros for none.
        estimate: flow that the Gaussians' polynomials are fitted to; None = at rest.
        rng: source of the sampling.
    """
    height, width = frames.shape[1:3]
    where = density(frames)
    chosen = _sample_pixels(where.ravel(), gaussians, rng)
    pixels = np.stack([chosen % width, chosen // width], 1)
    jittered = (pixels + rng.uniform(0, 1, pixels.shape)) / (width, height)
    order = tile_order((2 * jittered - 1).astype(np.float32), (width, height))
    chosen, pixels, inside = chosen[order], pixels[order], jittered[order].astype(np.float32)
    sigma = np.clip(0.45 / np.sqrt(gaussians * where.ravel()[chosen]), *_SIGMA_RANGE)

    middle = int(np.abs(taus).argmin())
    linear, quadratic = np.zeros_like(inside), np.zeros_like(inside)
    if estimate is not None and len(frames) > 1:
        linear, quadratic = fit_motion(frames, taus, middle, inside, estimate)
    position = 2 * inside - 1 - linear * taus[middle] - quadratic * taus[middle] ** 2
    gx, gy, gt = grid

    def still_gop(colour: Float32Array) -> Gop:
        return Gop(
            position=position.astype(np.float32),
            log_scale=np.log(np.stack([sigma, sigma], 1)).astype(np.float32),
            rotation=np.zeros(len(inside), np.float32),
            colour=colour,
            alpha=np.full(len(inside), _INITIAL_ALPHA, np.float32),
            linear=linear,
            quadratic=quadratic,
            xy=rng.normal(0, _PLANE_NOISE, (gy, gx, TRIPLANE_CHANNELS)).astype(np.float32),
            xt=np.ones((gt, gx, TRIPLANE_CHANNELS), np.float32),
            yt=np.ones((gt, gy, TRIPLANE_CHANNELS), np.float32),
        )

    unit = still_gop(np.ones((len(inside), 3), np.float32))
    weight = render_weights(unit, float(taus[middle]), (width, height))
    x, y = pixels[:, 0], pixels[:, 1]
    colour = frames[middle, y, x] / 255.0 / np.maximum(weight[y, x], 0.3)[:, None]
    return still_gop(colour.astype(np.float32))


def random_start(
    frames: Frames, gaussians: int, grid: tuple[int, int, int], rng: np.random.Generator
) -> Gop:
    """Start as the paper does: anywhere, at rest, in any colour."""
    height, width = frames.shape[1:3]
    gx, gy, gt = grid
    spacing = np.float32(np.sqrt(width * height / gaussians))

    def uniform(low: float, high: float, *shape: int) -> Float32Array:
        return rng.uniform(low, high, shape).astype(np.float32)

    position = uniform(-1, 1, gaussians, 2)
    return Gop(
        position=position[tile_order(position, (width, height))],
        log_scale=np.log(spacing * uniform(0.25, 1.0, gaussians, 2)),
        rotation=uniform(0, np.pi, gaussians),
        colour=uniform(0, 0.5, gaussians, 3),
        alpha=np.full(gaussians, 0.5, np.float32),
        linear=np.zeros((gaussians, 2), np.float32),
        quadratic=np.zeros((gaussians, 2), np.float32),
        xy=rng.normal(0, _PLANE_NOISE, (gy, gx, TRIPLANE_CHANNELS)).astype(np.float32),
        xt=np.ones((gt, gx, TRIPLANE_CHANNELS), np.float32),
        yt=np.ones((gt, gy, TRIPLANE_CHANNELS), np.float32),
    )


def _sample_pixels(
    weights: NDArray[np.float64], count: int, rng: np.random.Generator
) -> NDArray[np.int64]:
    """Pick `count` pixels by weight; without replacement as long as there are enough."""
    whole, rest = divmod(count, len(weights))
    repeats = [np.arange(len(weights))] * whole
    # The largest log(u)/w are a sample without replacement (Efraimidis and Spirakis).
    keys = np.log(rng.random(len(weights))) / weights
    return np.concatenate([*repeats, np.argpartition(-keys, max(rest - 1, 0))[:rest]])


def fit_motion(
    frames: Frames | Sequence[Frames],
    taus: Float32Array,
    start: int,
    points: Float32Array,
    estimate: FlowEstimator,
) -> tuple[Float32Array, Float32Array]:
    """Least-squares motion a1 tau + a2 tau^2 of points (N, 2), in [0, 1) of frame `start`.

    Returns:
        a1 and a2, both (N, 2) in normalised units ([-1, 1] is the frame).
    """
    small = [resize(frame, _FLOW_HEIGHT) for frame in frames]
    tracks = track(small, start, points, estimate)
    moved = 2 * (tracks - tracks[start])
    basis = np.stack([taus - taus[start], taus**2 - taus[start] ** 2], 1)
    # Two frames fix a line only, and so do frames at nearly the same two times.
    basis = basis[:, : min(2, len(taus) - 1)]
    solution = np.linalg.pinv(basis, rcond=_LEAST_CONDITION).astype(np.float32)
    motion = np.tensordot(solution, moved, axes=(1, 0))
    if len(motion) == 1:
        motion = np.concatenate([motion, np.zeros_like(motion)])
    return np.ascontiguousarray(motion[0]), np.ascontiguousarray(motion[1])
