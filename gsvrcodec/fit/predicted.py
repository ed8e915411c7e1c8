"""A predicted fit: Gaussians of the reference are kept, carried on and changed, or replaced."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.fit.fitting import Allowance, Fit, mean_psnr, price_of
from gsvrcodec.fit.footage import Footage, Picture, some_frames
from gsvrcodec.fit.motion import Tracker, flow_estimator
from gsvrcodec.fit.moving import OverTime, to_be_static
from gsvrcodec.fit.number import called_for
from gsvrcodec.fit.optimise import optimise
from gsvrcodec.fit.parameters import LOOK, Anchor, Parameters
from gsvrcodec.fit.precision import noise
from gsvrcodec.fit.recipe import PREDICTED, FitOptions
from gsvrcodec.fit.relocate import effects, move_weakest, sums_at
from gsvrcodec.fit.start import affordable, tri_plane
from gsvrcodec.fit.target import Slope, bit_worth
from gsvrcodec.fit.tiles import Tiles
from gsvrcodec.fit.tuned import MOVING, PREDICTION, START
from gsvrcodec.model.gop import Float32Array, Gop, GridSize
from gsvrcodec.model.prediction import Look, start_of_motion
from gsvrcodec.model.reconstruction import MOST_LOG_OPACITY
from gsvrcodec.model.static import select_gaussians, static_gop
from gsvrcodec.render.backend import Backend


@dataclass(frozen=True, slots=True, eq=False)
class LastFrame:
    """The last frame of the reference, from which a predicted fit starts."""

    look: Look  #: (M, ...) the Gaussians as in the last frame of the reference
    picture: Picture  #: (H, W, 3) that frame, decoded
    source: Picture  #: (H, W, 3) that frame, as it was to be shown
    qscale: float  #: that the GOP may be stored at; sets what a change costs
    psnr: float  #: dB, mean of the frames of the reference


def fit_predicted(
    footage: Footage,
    reference: LastFrame,
    gaussians: int,
    grid: GridSize,
    options: FitOptions,
    allowance: Allowance,
    backend: Backend,
    *,
    seed: tuple[int, ...],
    slope: Slope | None = None,
    least_kept: float = PREDICTION.kept,
) -> Fit | None:
    """Fit the Gaussians of a reference to the frames that follow it.

    There is no fit where the optical flow loses them, for one from their places takes longer than
    one that begins with nothing. With a slope, there is none where most of them would change: a
    change takes about as many bits as a new Gaussian, which is free to be where it is needed.

    The same arguments give the same result in any process, unless there is a wall time.

    Args:
        footage: frames to show.
        reference: Gaussians to begin with.
        gaussians: N of the GOP; with a slope a first guess.
        grid: Gx, Gy, Gt of the tri-plane; zeros for none.
        options: deformation field, flow.
        allowance: steps or wall time of start, fit and tuning together.
        backend: the renderer.
        seed: of every random choice.
        slope: that the number of Gaussians which change follows; None = their number stays.
        least_kept: with a slope, share of the Gaussians that have to stay as they are.

    Returns:
        The fit; None if the frames cannot be predicted from the reference.
    """
    began = time.perf_counter()
    rng = np.random.default_rng(seed)
    # Dropped first, so that those around them are not kept as they are.
    there = _strongest(reference.look, footage, gaussians, backend)
    look = reference.look[there]
    worth = change_worth(static_gop(*_values(look)), footage, rng, backend)
    bit = bit_worth(reference.qscale)
    least = PREDICTION.kept_bits * bit
    over_time, worth_of_motion = OverTime(footage.frames), MOVING.predicted_bits * bit
    where = over_time.moving(worth_of_motion)
    still = to_be_static(look, where | over_time.changed(reference.source, worth_of_motion))
    worth[still & (worth < PREDICTION.still_worth * least)] = 0
    if slope is not None and (worth < least).mean() < least_kept:
        return None
    stays = worth < _least_worth(worth, least, allowance.gaussians)
    extra = gaussians - len(there)
    if stays.all() and extra <= 0:
        stays[worth.argmax()] = False  # something has to be fitted
    kept = np.zeros(len(reference.look.position), np.bool_)
    kept[there[stays]] = True
    carried = there[~stays]
    behind = static_gop(*_values(look[stays])) if kept.any() else None
    footage = replace(footage, background=behind, moving=where)
    grid = affordable(grid, max(len(carried) + extra, 1), backend.blending)
    start = start_of_motion(len(footage.frames))
    anchor = Anchor(start, reference.look[carried], carried)
    begin = _start(footage, anchor, reference.picture, grid, options, rng)
    effort, tuning = allowance.split(
        tune=options.tune, least_steps=PREDICTION.least_steps, began=began
    )
    parameters = Parameters(begin, options.deform, backend, footage.background, anchor)
    if slope is not None:  # what comes into the picture needs more than those that change
        how = PREDICTION.begun, effort.expected_steps, effort.gaussians
        extra = max(extra, called_for(slope, parameters, footage, *how) - len(begin))
    if extra > 0:
        begin, anchor = _with_new(begin, anchor, extra)
        parameters = Parameters(begin, options.deform, backend, footage.background, anchor)
    static = np.resize(to_be_static(look[~stays], where), len(begin))
    parameters.make_static(np.arange(len(begin)), static)
    begin = parameters.stored()
    fresh = max(extra, int(PREDICTION.renewed_first * len(begin)))
    lost = min(PREDICTION.lost, reference.psnr - PREDICTION.lost_fall)
    began_with = mean_psnr(parameters.gop(), footage, backend)
    if stays.mean() < PREDICTION.still and began_with < lost:
        return None
    move_weakest(parameters, footage.frames, footage.taus, footage.size, rng, fresh, where)

    price = price_of(parameters, footage, reference.qscale, rng)
    tiles = Tiles(footage.size, look.position[~stays], worth[~stays])
    optimise(parameters, footage, PREDICTED, effort, rng, price=price, slope=slope, tiles=tiles)
    gop, ended_with = parameters.stored(), mean_psnr(parameters.gop(), footage, backend)
    final = parameters.anchor
    if ended_with < began_with:  # as in a still film
        gop, ended_with, final = begin, began_with, anchor
    return Fit(gop, ended_with, effort.expected_steps, tuning, footage, final, kept)


def change_worth(
    gop: Gop, footage: Footage, rng: np.random.Generator, backend: Backend
) -> NDArray[np.float64]:
    """What the best change of each Gaussian may be worth, if all others stay.

    By a step of Gauss and Newton: with the gradient g of the error in a parameter and its
    sensitivity h, the error falls by g^2 / h. The change of a look lasts for all frames; that of
    a position may differ from frame to frame, which is motion.

    Args:
        gop: static Gaussians as they would be kept, N of them.
        footage: frames to show.
        rng: source of the noise that sensitivities are measured with.
        backend: gives gradients.

    Returns:
        (N,) squared 8-bit codes (mean of the channels) over all frames.
    """
    size, frames = footage.size, len(footage.frames)
    picture = np.clip(backend.picture(backend.prepare(gop), 0.0, size, size), 0, 1)
    chosen = some_frames(frames, PREDICTION.frames)
    sensitivity = {name: np.zeros(getattr(gop, name).shape) for name in LOOK}
    total = {name: np.zeros(getattr(gop, name).shape) for name in LOOK}
    squares = np.zeros(gop.position.shape)
    for _ in range(PREDICTION.draws):
        found = backend.gradient(gop, 0.0, noise((*size[::-1], 3), rng), size)
        for name, sums in sensitivity.items():
            sums += np.square(getattr(found, name)) / PREDICTION.draws
    for index in chosen:
        residual = footage.frames[index].astype(np.float32) / 255 - picture
        found = backend.gradient(gop, 0.0, residual, size)
        for name, sums in total.items():
            sums += getattr(found, name)
        squares += np.square(found.position, dtype=np.float64)
    gain = np.zeros(len(gop))
    for name, sums in total.items():
        h = np.maximum(sensitivity[name], PREDICTION.floor * sensitivity[name].mean() + 1e-30)
        lasting = np.square(sums) / (len(chosen) * h)
        gain += lasting.reshape(len(gop), -1).sum(axis=1)
        if name == "position":
            gain += (squares / h - lasting).sum(axis=1)
    worth: NDArray[np.float64] = gain * (255.0**2 / 3 * frames / len(chosen))
    return worth


def _least_worth(worth: NDArray[np.float64], least: float, most: float) -> float:
    """Return what a change has to be worth: `least`, or more so that about `most` of them are."""
    if most >= len(worth):
        return least
    enough = float(np.partition(worth, -int(most))[-int(most)]) if most >= 1 else math.inf
    return min(max(least, enough), PREDICTION.hurried * least)


def _strongest(look: Look, footage: Footage, count: int, backend: Backend) -> NDArray[np.intp]:
    """Return which Gaussians are the `count` that the picture needs most, in their order."""
    if count >= len(look.position):
        return np.arange(len(look.position))
    gop = static_gop(*_values(look))
    now, size = np.zeros(1, np.float32), footage.size
    found = effects(gop, sums_at(gop, now, size, size, backend), size, backend)
    return np.sort(np.argsort(-found, kind="stable")[:count])


def _values(look: Look) -> tuple[Float32Array, ...]:
    return tuple(np.ascontiguousarray(getattr(look, name)) for name in LOOK)


def _start(
    footage: Footage,
    anchor: Anchor,
    before: Picture,
    grid: GridSize,
    options: FitOptions,
    rng: np.random.Generator,
) -> Gop:
    """Stored values to begin with: no change, and the motion of the optical flow."""
    count, look = len(anchor.source), anchor.look
    linear, quadratic = np.zeros((2, count, 2), np.float32)
    if count and options.deform != "triplane" and len(footage.frames) > 1:
        tracker = Tracker([before, *footage.frames], flow_estimator(options.flow, near=True))
        inside = np.clip((look.position + 1) / 2, 0, 1 - 1e-6).astype(np.float32)
        taus = np.concatenate([np.array([anchor.start], np.float32), footage.taus])
        linear, quadratic = tracker.motion(taus, 0, inside)
    xy, xt, yt = tri_plane(grid, rng)
    return Gop(
        **{name: np.zeros_like(getattr(look, name)) for name in LOOK},
        indicator=np.full(count, START.indicator, np.float32),
        linear=linear,
        quadratic=quadratic,
        xy=xy,
        xt=xt,
        yt=yt,
    )


def _with_new(start: Gop, anchor: Anchor, count: int) -> tuple[Gop, Anchor]:
    """Append Gaussians that hardly show, which have to be moved to where they are needed."""
    had = len(anchor.source)
    order = np.arange(had + count) % max(had, 1)
    if had:
        start = select_gaussians(start, order)
        look = Look(*(getattr(anchor.look[order], name) for name in LOOK))
        source = anchor.source[order]
    else:
        start = replace(
            start,
            **{
                name: np.zeros((count, *getattr(start, name).shape[1:]), np.float32)
                for name in (*LOOK, "indicator", "linear", "quadratic")
            },
        )
        look = Look(*(getattr(start, name).copy() for name in LOOK))
        source = np.full(count, -1)
    out = Anchor(anchor.start, look, source)
    out.release(np.arange(had, had + count))
    log_opacity = np.where(np.arange(had + count) < had, start.log_opacity, -MOST_LOG_OPACITY)
    return replace(start, log_opacity=log_opacity.astype(np.float32)), out
