"""Relocation: the Gaussians that do least for the picture move to where the error is largest."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

from gsvrcodec.fit.footage import Footage, Frames, Moving, Picture, some_frames
from gsvrcodec.fit.parameters import Parameters
from gsvrcodec.fit.plate import mendable
from gsvrcodec.fit.tuned import EFFECT, RELOCATION
from gsvrcodec.model.gop import Float32Array, Gop
from gsvrcodec.model.plate import Plate
from gsvrcodec.model.prediction import arrays_of, look_at
from gsvrcodec.model.reconstruction import GROUND, MOST_LOG_OPACITY, PLATE_WEIGHT
from gsvrcodec.model.static import append_gaussians
from gsvrcodec.native import _core
from gsvrcodec.render.backend import Backend, Size
from gsvrcodec.render.order import drawing_order


def sums_at(
    gop: Gop, taus: Float32Array, size: Size, coded_size: Size, backend: Backend
) -> Iterator[tuple[float, Float32Array]]:
    """Yield normalised times, and the sums (h, w, 4) of a GOP then."""
    prepared = backend.prepare(gop)
    for tau in taus.tolist():
        yield tau, backend.sums(prepared, tau, size, coded_size)


def effects(
    gop: Gop, pictures: Iterable[tuple[float, Float32Array]], coded_size: Size, backend: Backend
) -> NDArray[np.float64]:
    """Squared change of pictures without each Gaussian, summed over colours and pixels.

    A Gaussian of the colour c that has the share s of the weights at a pixel of the colour P
    changes it by s / (1 - s) (P - c) when it leaves. The square of that is looked at in 24 places
    around the centre and integrated by the rule of Gauss and Laguerre.

    Args:
        gop: N Gaussians.
        pictures: Normalised times, and the sums (h, w, 4) of these Gaussians and all others
            then; see `sums_at`.
        coded_size: Width and height of the coded frame, pixels.
        backend: Says how pictures are formed.

    Returns:
        (N,) 0 for Gaussians that do not reach into the frame at the times that are looked at.
    """
    total = np.zeros(len(gop))
    for tau, sums in pictures:
        look = arrays_of(look_at(gop, tau, backend.blending))
        _core.add_effects(look, sums, *coded_size, total, backend.threads)
    return total


def losses(gop: Gop, footage: Footage, backend: Backend) -> NDArray[np.float64]:
    """Squared error that is added without each Gaussian, over all frames, 8-bit codes.

    Args:
        gop: N Gaussians of a fit, of which none would lessen the error by leaving.
        footage: The frames that show them.
        backend: Draws.
    """
    drawn = gop if footage.background is None else append_gaussians(gop, footage.background)
    taus, size = footage.taus[some_frames(len(footage.taus), EFFECT.frames)], footage.size
    found = effects(gop, sums_at(drawn, taus, size, size, backend), size, backend)
    return found * (255.0**2 / 3 * len(footage.taus) / len(taus))


def relocate(
    parameters: Parameters,
    frames: Frames,
    taus: Float32Array,
    coded_size: tuple[int, int],
    rng: np.random.Generator,
    share: float,
    more: int = 0,
    moving: Moving | None = None,
) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Move the weakest Gaussians of `parameters`, in place, and put all in rendering order again.

    A Gaussian that moves takes the shape and the motion of its nearest neighbour, the colour that
    is wanted where it goes, and an opacity of 1, or more in proportion to the weights there.

    Args:
        parameters: Of the fit.
        frames: (F, h, w, 3) uint8 at the size that the error is measured at.
        taus: (F,) their normalised times.
        coded_size: width and height of the coded frame, pixels.
        rng: source of the new places.
        share: fraction of the Gaussians that moves.
        more: Gaussians that are added; below 0 = the weakest leave.
        moving: (H, W) where the source moves; None = everywhere. What comes elsewhere is static.

    Returns:
        (N,) the index that each Gaussian had before, and (N,) whether it is new there.
    """
    added, leaving = max(0, more), max(0, -more)
    count = int(share * len(parameters.raw["position"])) + added
    taken = np.arange(len(parameters.raw["position"]))
    if leaving:
        size = frames.shape[2], frames.shape[1]
        shown = some_frames(len(taus), EFFECT.frames)
        pictures = sums_at(parameters.drawn(), taus[shown], size, coded_size, parameters.backend)
        found = effects(parameters.gop(), pictures, coded_size, parameters.backend)
        taken = np.sort(np.argsort(found, kind="stable")[leaving:])
    if more:
        # Copies that hardly show are the weakest, so that they move.
        taken = np.concatenate([np.zeros(added, np.intp), taken])
        parameters.rearrange(taken)
        hidden = np.full(added, -MOST_LOG_OPACITY, np.float32)
        parameters.renew(np.arange(added), np.arange(added), log_opacity=hidden)
    moved = move_weakest(parameters, frames, taus, coded_size, rng, count, moving)
    order = reorder(parameters, coded_size)
    return taken[order], np.isin(order, moved)


def move_weakest(
    parameters: Parameters,
    frames: Frames,
    taus: Float32Array,
    coded_size: tuple[int, int],
    rng: np.random.Generator,
    count: int,
    moving: Moving | None = None,
) -> NDArray[np.intp]:
    """Move the `count` weakest Gaussians, and return which they are; the rest as `relocate`."""
    gop = parameters.gop()
    size = frames.shape[2], frames.shape[1]
    shown = some_frames(len(frames), RELOCATION.frames)
    looked_at = some_frames(len(frames), EFFECT.frames)
    found, weights, errors = np.zeros(len(gop)), [], []
    pictures = sums_at(parameters.drawn(), taus[shown], size, coded_size, parameters.backend)
    for index, (tau, sums) in zip(shown, pictures, strict=True):
        if index in looked_at:
            found += effects(gop, [(tau, sums)], coded_size, parameters.backend)
        weights.append(sums[..., 3] + GROUND)
        errors.append(_error(sums, frames[index], parameters.backend.plate))
    weakest = np.argsort(found, kind="stable")[:count]
    bounds = np.cumsum([error.sum(dtype=np.float64) for error in errors])
    bounds = (bounds / bounds[-1] * count).round().astype(np.intp)

    like = np.empty(count, np.intp)
    position, colour = np.empty((count, 2), np.float32), np.empty((count, 3), np.float32)
    weight, static = np.empty(count, np.float32), np.zeros(count, np.bool_)
    each = zip(weights, errors, shown, [0, *bounds[:-1]], bounds, strict=True)
    for there, error, index, begin, end in each:
        pixels = _stratified(error.ravel(), end - begin, rng)
        x, y = pixels % size[0], pixels // size[0]
        tau = taus[index]
        moved = gop.position + gop.linear * tau + gop.quadratic * tau**2
        near = _nearest(moved, (-(-size[0] // 2), -(-size[1] // 2)))[y // 2, x // 2]
        like[begin:end] = near
        colour[begin:end] = frames[index, y, x] / np.float32(255)
        weight[begin:end] = there[y, x]
        places = (np.stack([x, y], 1) + rng.uniform(0, 1, (end - begin, 2))) / size
        if moving is not None:
            column, row = (places * moving.shape[::-1]).astype(np.intp).T
            static[begin:end] = ~moving[row, column]
        way = np.where(static[begin:end, None], 0, moved[near] - gop.position[near])
        position[begin:end] = 2 * places - 1 - way

    low, high = RELOCATION.sigma_range
    parameters.renew(
        weakest,
        like,
        position=position,
        colour=colour,
        log_opacity=np.log(np.maximum(RELOCATION.weight * weight, 1)),
        log_scale=np.clip(gop.log_scale[like], math.log(low), math.log(high)),
    )
    if moving is not None:
        parameters.make_static(weakest, static)
    return weakest


def reorder(parameters: Parameters, coded_size: tuple[int, int]) -> NDArray[np.intp]:
    """Put the Gaussians in rendering order, in place; return the index that each had before."""
    now = parameters.tensors()
    position, log_scale = (
        parameters.backend.fetch(now[name]) for name in ("position", "log_scale")
    )
    order = drawing_order(position, log_scale, coded_size)
    parameters.rearrange(order)
    return order


def _error(sums: Float32Array, wanted: Picture, plate: Plate | None) -> Float32Array:
    """Squared error around each pixel, (h, w), above zero: what Gaussians can mend of it.

    Args:
        sums: (h, w, 4) that the picture is made of.
        wanted: (h, w, 3) the frame.
        plate: Behind the Gaussians; None = nothing.
    """
    squares = np.empty(sums.shape[:2], np.float32)
    _core.pixel_errors(sums, wanted, squares)
    if plate is not None:
        share = 1 - np.float32(PLATE_WEIGHT) / (sums[..., 3] + np.float32(GROUND))
        size = wanted.shape[1::-1]
        usual = np.asarray(cv2.resize(plate.shown(), size, interpolation=cv2.INTER_AREA), np.uint8)
        squares *= mendable(share, wanted, usual)
    # In place: new memory would take longer than the filter.
    cv2.boxFilter(squares, -1, 2 * (RELOCATION.error_box_px,), dst=squares)
    return np.maximum(squares, np.float32(1e-6), out=squares)


def _stratified(weights: Float32Array, count: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """Draw one number from each of `count` parts of `weights` (K,) that have equal sums."""
    sums = np.cumsum(weights, dtype=np.float64)
    drawn = (np.arange(count) + rng.uniform(0, 1, count)) * (sums[-1] / max(count, 1))
    numbers: NDArray[np.intp] = np.minimum(np.searchsorted(sums, drawn), len(weights) - 1)
    return numbers


def _nearest(position: Float32Array, size: tuple[int, int]) -> NDArray[np.intp]:
    """Return which Gaussian is nearest to each pixel, (h, w)."""
    width, height = size
    pixel = (position + 1) / 2 * (width, height)
    x, y = np.clip(pixel, 0, (width - 1, height - 1)).astype(np.intp).T
    free = np.ones((height, width), np.uint8)
    free[y, x] = 0
    labels = cv2.distanceTransformWithLabels(free, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)[
        1
    ]
    owner = np.zeros(int(labels.max()) + 1, np.intp)
    owner[labels[y, x]] = np.arange(len(position))
    nearest: NDArray[np.intp] = owner[labels]
    return nearest
