"""What each Gaussian does for the picture: how much would change without it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.fit.footage import Footage, some_frames
from gsvrcodec.fit.tuned import EFFECT
from gsvrcodec.model.gop import Float32Array, Gop
from gsvrcodec.model.reconstruction import CUTOFF, GROUND
from gsvrcodec.model.static import append_gaussians
from gsvrcodec.render.backend import Backend, Size


def effects(
    gop: Gop, drawn: Gop, taus: Float32Array, size: Size, coded_size: Size, backend: Backend
) -> NDArray[np.float64]:
    """Squared change of the picture without each Gaussian, about.

    A Gaussian of the colour c that has the share s of the weights at a pixel of the colour P
    changes it by s / (1 - s) (P - c) when it leaves. The change at its centre, or where the frame
    is nearest to that, stands for that over its area. Offsets of the tri-plane are left out: they
    are small, and take long to look up.

    Args:
        gop: N Gaussians.
        drawn: These and all others of the pictures.
        taus: (F,) normalised times of the frames.
        size: Width and height that pictures are drawn at, pixels.
        coded_size: Width and height of the coded frame, pixels.
        backend: Draws.

    Returns:
        (N,) 0 for Gaussians that do not reach into the frame at the times that are looked at.
    """
    prepared = backend.prepare(drawn)
    total = np.zeros(len(gop))
    for tau in taus[some_frames(len(taus), EFFECT.frames)]:
        sums = backend.sums(prepared, float(tau), size, coded_size).astype(np.float64)
        x, y, own = _weights(gop, float(tau), size, coded_size)
        there = sums[y, x]
        weight = there[:, 3] + GROUND
        share = np.minimum(own / weight, EFFECT.most_share)
        apart = there[:, :3] / weight[:, None] - gop.colour
        total += np.square(share / (1 - share)) * np.square(apart).sum(axis=1)
    return np.asarray(total * np.exp(gop.log_scale.sum(axis=1)))


def losses(gop: Gop, footage: Footage, sensitivities: Gop, backend: Backend) -> NDArray[np.float64]:
    """Squared error that is added without each Gaussian, over all frames, 8-bit codes.

    The sensitivity of the logarithm of its opacity is the sum of s^2 (P - c)^2 over all pixels,
    with s and P as in `effects`; its share where its centre is stands for the rest.

    Args:
        gop: N Gaussians.
        footage: The frames that show them.
        sensitivities: Squared error of a change of each parameter by one.
        backend: Draws.
    """
    drawn = gop if footage.background is None else append_gaussians(gop, footage.background)
    prepared, size = backend.prepare(drawn), footage.size
    most = np.zeros(len(gop))
    for tau in footage.taus[some_frames(len(footage.taus), EFFECT.frames)]:
        x, y, own = _weights(gop, float(tau), size, size)
        weight = backend.sums(prepared, float(tau), size, size)[y, x, 3] + GROUND
        most = np.maximum(most, own / weight)
    others = 1 - np.minimum(most, EFFECT.most_lost)
    return np.asarray(sensitivities.log_opacity / np.square(others))


def _weights(
    gop: Gop, tau: float, size: Size, coded_size: Size
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.float64]]:
    """Pixels nearest to the centres, columns and rows, and the weights of the Gaussians there."""
    position = gop.position + tau * (gop.linear + tau * gop.quadratic)
    centre = (position + 1) / 2 * np.array(size)
    near = np.clip(centre, 0.5, np.array(size) - 0.5)
    x, y = ((near - centre) * np.array(coded_size) / size).T
    sine, cosine = np.sin(gop.rotation), np.cos(gop.rotation)
    along = np.stack([cosine * x + sine * y, cosine * y - sine * x], 1) / np.exp(gop.log_scale)
    weight = np.exp(-np.square(along).sum(axis=1) / 2) - CUTOFF
    column, row = near.astype(np.intp).T
    return column, row, np.exp(gop.log_opacity) * np.maximum(weight, 0)
