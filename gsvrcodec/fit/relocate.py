"""Relocation: the weakest Gaussians move to where the error is largest, during a fit."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from gsvrcodec.fit.effect import effects
from gsvrcodec.fit.field import Field
from gsvrcodec.fit.footage import Frames, some_frames
from gsvrcodec.fit.start import over_channels
from gsvrcodec.fit.tuned import RELOCATION
from gsvrcodec.model.gop import Float32Array
from gsvrcodec.model.reconstruction import GROUND, MOST_LOG_OPACITY
from gsvrcodec.render.order import drawing_order


def relocate(
    field: Field,
    frames: Frames,
    taus: Float32Array,
    coded_size: tuple[int, int],
    rng: np.random.Generator,
    share: float,
    more: int = 0,
) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Move the weakest Gaussians of `field`, in place, and put all in rendering order again.

    A Gaussian that moves takes the shape and the motion of its nearest neighbour, the colour that
    is wanted where it goes, and an opacity of 1, or more in proportion to the weights there.

    Args:
        field: the parameters of the fit.
        frames: (F, h, w, 3) uint8 at the size that the error is measured at.
        taus: (F,) their normalised times.
        coded_size: width and height of the coded frame, pixels.
        rng: source of the new places.
        share: fraction of the Gaussians that moves.
        more: Gaussians that are added; below 0 = the weakest leave.

    Returns:
        (N,) the index that each Gaussian had before, and (N,) whether it is new there.
    """
    added, leaving = max(0, more), max(0, -more)
    count = int(share * len(field.raw["position"])) + added
    taken = np.arange(len(field.raw["position"]))
    if leaving:
        size = frames.shape[2], frames.shape[1]
        taken = np.sort(_weakest_first(field, taus, size, coded_size)[leaving:])
    if more:
        # Copies that hardly show are the weakest, so that they move.
        taken = np.concatenate([np.zeros(added, np.intp), taken])
        field.rearrange(taken)
        field.raw["log_opacity"][:added] = -MOST_LOG_OPACITY
    moved = move_weakest(field, frames, taus, coded_size, rng, count)
    order = reorder(field, coded_size)
    return taken[order], np.isin(order, moved)


def move_weakest(
    field: Field,
    frames: Frames,
    taus: Float32Array,
    coded_size: tuple[int, int],
    rng: np.random.Generator,
    count: int,
) -> NDArray[np.intp]:
    """Move the `count` weakest Gaussians, and return which they are; the rest as `relocate`."""
    gop = field.gop()
    size = frames.shape[2], frames.shape[1]
    weakest = _weakest_first(field, taus, size, coded_size)[:count]
    shown = some_frames(len(frames), RELOCATION.frames)
    prepared = field.backend.prepare(field.drawn())
    sums = [field.backend.sums(prepared, float(tau), size, coded_size) for tau in taus[shown]]
    errors = [_error(own, frames[i]) for own, i in zip(sums, shown, strict=True)]
    bounds = np.cumsum([error.sum() for error in errors])
    bounds = (bounds / bounds[-1] * count).round().astype(np.intp)

    like = np.empty(count, np.intp)
    position, colour = np.empty((count, 2), np.float32), np.empty((count, 3), np.float32)
    weight = np.empty(count, np.float32)
    each = zip(sums, errors, shown, [0, *bounds[:-1]], bounds, strict=True)
    for own, error, index, begin, end in each:
        pixels = _stratified(error.ravel(), end - begin, rng)
        x, y = pixels % size[0], pixels // size[0]
        tau = taus[index]
        moved = gop.position + gop.linear * tau + gop.quadratic * tau**2
        near = _nearest(moved, (-(-size[0] // 2), -(-size[1] // 2)))[y // 2, x // 2]
        like[begin:end] = near
        colour[begin:end] = frames[index, y, x] / np.float32(255)
        weight[begin:end] = own[y, x, 3] + GROUND
        places = (np.stack([x, y], 1) + rng.uniform(0, 1, (end - begin, 2))) / size
        position[begin:end] = 2 * places - 1 - (moved[near] - gop.position[near])

    low, high = RELOCATION.sigma_range
    field.renew(
        weakest,
        like,
        position=position,
        colour=colour,
        log_opacity=np.log(np.maximum(RELOCATION.weight * weight, 1)),
        log_scale=np.clip(gop.log_scale[like], math.log(low), math.log(high)),
    )
    return weakest


def _weakest_first(
    field: Field, taus: Float32Array, size: tuple[int, int], coded_size: tuple[int, int]
) -> NDArray[np.intp]:
    """Numbers of the Gaussians: first those without which the picture changes least."""
    found = effects(field.gop(), field.drawn(), taus, size, coded_size, field.backend)
    return np.argsort(found, kind="stable")


def reorder(field: Field, coded_size: tuple[int, int]) -> NDArray[np.intp]:
    """Put the Gaussians of `field` in rendering order, in place; return the old index of each."""
    now = field.tensors()
    position, log_scale = (now[name].numpy(force=True) for name in ("position", "log_scale"))
    order = drawing_order(position, log_scale, coded_size)
    field.rearrange(order)
    return order


def _error(sums: Float32Array, wanted: Frames) -> NDArray[np.float64]:
    """Squared error around each pixel, (h, w), above zero; of sums (h, w, 4)."""
    picture = np.clip(sums[..., :3] / (sums[..., 3:] + GROUND), 0, 1)
    squares = over_channels(np.square(255 * picture - wanted))
    blurred = cv2.boxFilter(squares, -1, 2 * (RELOCATION.error_box_px,))
    error: NDArray[np.float64] = np.maximum(blurred, 1e-6, dtype=np.float64)
    return error


def _stratified(
    weights: NDArray[np.float64], count: int, rng: np.random.Generator
) -> NDArray[np.intp]:
    """Draw one number from each of `count` parts of `weights` (K,) that have equal sums."""
    sums = np.cumsum(weights)
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
