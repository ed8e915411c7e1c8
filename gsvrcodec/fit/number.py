"""How many Gaussians a fit has: as many as pay for their bits."""

from __future__ import annotations

from statistics import fmean, geometric_mean

import cv2
import numpy as np
from numpy.typing import NDArray

from gsvrcodec.fit.footage import Footage, some_frames
from gsvrcodec.fit.parameters import Parameters
from gsvrcodec.fit.plate import mendable
from gsvrcodec.fit.relocate import losses
from gsvrcodec.fit.start import over_channels
from gsvrcodec.fit.target import Slope
from gsvrcodec.fit.tuned import PREDICTION, RELOCATION, SLOPE
from gsvrcodec.model.gop import Float32Array, Gop
from gsvrcodec.model.reconstruction import GROUND, PLATE_WEIGHT
from gsvrcodec.render.backend import Size


class Number:
    """The number of Gaussians of one fit, by a slope.

    The error alone does not tell what one more Gaussian would save: where it is noise, or motion
    that none can follow, nothing. So those that came last are looked at before more are called
    for: what the pictures would lose without them.
    """

    def __init__(self, slope: Slope) -> None:
        self._slope = slope
        self._last: NDArray[np.bool_] | None = None  # (N,) which came last; None = not known
        self._paid = [1.0]  # as is usual, and what each look has found

    def rearranged(self, order: NDArray[np.intp], moved: NDArray[np.bool_] | None) -> None:
        """Follow the Gaussians into another order; `moved`, (N,): those that came by that."""
        if moved is not None:
            self._last = moved
        elif self._last is not None:
            self._last = self._last[order]

    def missing(self, parameters: Parameters, footage: Footage, steps: float, fitted: float) -> int:
        """Return how many Gaussians are missing; below 0 = too many.

        Args:
            parameters: Of the fit.
            footage: The frames that show them.
            steps: Of the whole fit.
            fitted: Gaussians that its time suffices for.
        """
        now = len(parameters.raw["position"])
        predicted = parameters.anchor is not None
        factor = PREDICTION.numbers if predicted else self._pays(parameters, footage)
        wanted = called_for(self._slope, parameters, footage, factor, steps, fitted)
        return min(max(wanted, now // 2), 2 * now) - now

    def prune(self, parameters: Parameters, footage: Footage) -> NDArray[np.intp]:
        """Drop Gaussians that are not worth their bits, and return which are left."""
        gop = parameters.gop()
        found = losses(gop, footage, parameters.backend)
        left = np.flatnonzero(self._slope.worthwhile(found, moving_of(gop, footage.size)))
        parameters.rearrange(left)
        self._last = None  # Those that are left of them all pay.
        return left

    def _pays(self, parameters: Parameters, footage: Footage) -> float:
        """Return how well those pay that came last, the mean of all looks so far."""
        if self._last is not None and self._last.any():
            gop = parameters.gop()
            found = losses(gop, footage, parameters.backend)[self._last]
            self._paid.append(self._slope.paid(found, float(moving_of(gop, footage.size).mean())))
        return geometric_mean(self._paid)


def called_for(
    slope: Slope,
    parameters: Parameters,
    footage: Footage,
    factor: float,
    steps: float,
    fitted: float,
) -> int:
    """Return how many Gaussians a slope calls for, by the error that is left.

    Args:
        slope: What a bit has to save.
        parameters: Of the fit so far.
        footage: The frames that show them.
        factor: Of the error: the part that more Gaussians may mend.
        steps: Of the whole fit.
        fitted: Gaussians that its time suffices for.
    """
    error = factor * _squared_error(parameters, footage)
    moving = float(moving_of(parameters.gop(), footage.size).mean())
    return slope.gaussians(footage.pixels, error, steps, moving, fitted)


def moving_of(gop: Gop, size: Size) -> NDArray[np.bool_]:
    """Which Gaussians move by more than `SLOPE.moving_px`, (N,), in frames of this size."""
    ways = [np.abs(way * (np.array(size) / 2)).max(axis=1) for way in (gop.linear, gop.quadratic)]
    return np.asarray(sum(ways) > SLOPE.moving_px)


def _squared_error(parameters: Parameters, footage: Footage) -> float:
    """Mean squared error over some frames, 8-bit codes.

    Where a background or a plate shows, too, an error counts by the share of the Gaussians; in
    front of a plate wholly where a frame differs from it.
    """
    frames, backend, size = footage.frames, parameters.backend, footage.size
    shown = some_frames(len(frames), RELOCATION.frames)
    pictures = backend.render(backend.prepare(parameters.drawn()), footage.taus[shown], size, size)
    plate = backend.plate
    if parameters.background is None and plate is None:
        pairs = zip(pictures, frames[shown], strict=True)
        return fmean(cv2.norm(*pair, cv2.NORM_L2SQR) / pair[0].size for pair in pairs)
    behind: float | Float32Array = PLATE_WEIGHT
    if parameters.background is not None:
        behind = backend.sums(backend.prepare(parameters.background), 0.0, size, size)[..., 3]
    usual = None if plate is None else plate.shown()
    alone = backend.over(None)
    own, errors = alone.prepare(parameters.gop()), []
    for picture, index in zip(pictures, shown, strict=True):
        weight = alone.sums(own, float(footage.taus[index]), size, size)[..., 3]
        squares = over_channels(np.square(cv2.absdiff(picture, frames[index]), dtype=np.float32))
        share = weight / (weight + behind + GROUND)
        if usual is not None:
            share = mendable(share, frames[index], usual)
        errors.append(float((squares / 3 * share).mean()))
    return fmean(errors)
