"""One fit: frames in, Gaussians out, before quantisation."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from statistics import fmean

import cv2
import numpy as np
from numpy.typing import NDArray

from gsvrcodec.fit.footage import Footage
from gsvrcodec.fit.motion import flow_estimator
from gsvrcodec.fit.moving import OverTime, to_be_static
from gsvrcodec.fit.optimise import Effort, optimise
from gsvrcodec.fit.parameters import Anchor, Parameters
from gsvrcodec.fit.precision import equal_slope_steps, sensitivities
from gsvrcodec.fit.price import Price
from gsvrcodec.fit.recipe import MAIN, FitOptions
from gsvrcodec.fit.start import content_aware
from gsvrcodec.fit.target import Slope, bit_worth
from gsvrcodec.fit.tuned import EFFORT, MOVING, PRICE, STAGED
from gsvrcodec.metrics import MAX_PSNR
from gsvrcodec.model.gop import Gop, GridSize
from gsvrcodec.model.static import append_gaussians
from gsvrcodec.render.backend import Backend


@dataclass(frozen=True, slots=True)
class Allowance:
    """How long to optimise."""

    steps: float  #: optimiser steps, without `seconds`
    seconds: float | None  #: wall time; None = by steps
    gaussians: float = math.inf  #: so many Gaussians may change in this time

    def split(
        self, *, tune: bool, least_steps: int, began: float
    ) -> tuple[Effort, Allowance | None]:
        """Divide into the effort of a fit, which begins now, and what is left for tuning.

        Args:
            tune: whether the fit is tuned under quantisation.
            least_steps: of the fit, without `seconds`.
            began: `time.perf_counter()` at the start of the whole.
        """
        share = STAGED.effort if tune else 0.0
        main = tuning = None
        if self.seconds is not None:
            left = self.seconds - (time.perf_counter() - began)
            main, tuning = max(0.1, (1 - share) * left), max(0.1, share * left)
        steps = max(least_steps, round((1 - share) * self.steps))
        effort = Effort(steps, main, self.gaussians)
        if not tune:
            return effort, None
        steps = max(EFFORT.least_tuning_steps, round(share * self.steps))
        return effort, Allowance(steps, tuning)


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """A fitted GOP before quantisation."""

    gop: Gop  #: as it is stored: relative to the anchor
    psnr: float  #: dB, mean of the frames
    steps: float  #: optimiser steps taken, or foreseen by a time budget
    tuning: Allowance | None  #: left for tuning under quantisation; None = no tuning
    footage: Footage  #: what was fitted, in front of the Gaussians that are kept
    anchor: Anchor | None = None  #: what `gop` is relative to; None = a key GOP
    kept: NDArray[np.bool_] | None = None  #: (M,) Gaussians of the reference that stay as they are

    def drawn(self, stored: Gop) -> Gop:
        """Return the Gaussians that stored values stand for."""
        return stored if self.anchor is None else self.anchor.gop(stored)


def fit_gop(
    footage: Footage,
    gaussians: int,
    grid: GridSize,
    options: FitOptions,
    allowance: Allowance,
    backend: Backend,
    *,
    seed: tuple[int, ...],
    slope: Slope | None = None,
) -> Fit:
    """Fit Gaussians to frames.

    The same arguments give the same result in any process, unless there is a wall time.

    Args:
        footage: frames to show, and the background behind the Gaussians.
        gaussians: N; with a slope a first guess.
        grid: Gx, Gy, Gt of the tri-plane; zeros for none.
        options: deformation field, flow, tuning.
        allowance: steps or wall time of start, fit and tuning together.
        backend: the renderer.
        seed: of every random choice.
        slope: that the number of Gaussians follows; None = their number stays.
    """
    began = time.perf_counter()
    rng = np.random.default_rng(seed)
    flow = None if options.deform == "triplane" else flow_estimator(options.flow, near=True)
    start = content_aware(footage, gaussians, grid, flow, rng, backend)
    qscale = slope.qscale if slope else PRICE.qscale
    where = OverTime(footage.frames).moving(MOVING.key_bits * bit_worth(qscale))
    footage = replace(footage, moving=where)
    parameters = Parameters(start, options.deform, backend, footage.background)
    parameters.make_static(np.arange(len(start)), to_be_static(start, where))
    effort, tuning = allowance.split(tune=options.tune, least_steps=EFFORT.least_steps, began=began)
    price = price_of(parameters, footage, qscale, rng)
    optimise(parameters, footage, MAIN, effort, rng, price=price, slope=slope)
    gop = parameters.gop()
    return Fit(gop, mean_psnr(gop, footage, backend), effort.expected_steps, tuning, footage)


def price_of(
    parameters: Parameters, footage: Footage, qscale: float, rng: np.random.Generator
) -> Price:
    """Return the price of bits for a fit of `parameters` that is stored at a qscale."""
    found = sensitivities(footage, parameters.gop(), rng, parameters.backend)
    if parameters.anchor is not None:
        found = parameters.anchor.costs(found)
    weight = bit_worth(qscale) / (255.0**2 * footage.pixels)
    return Price(equal_slope_steps(found, qscale), weight, parameters.backend)


def mean_psnr(gop: Gop, footage: Footage, backend: Backend) -> float:
    """Mean PSNR over the frames of `gop` in front of the background, dB."""
    if footage.background is not None:
        gop = append_gaussians(gop, footage.background)
    prepared = backend.prepare(gop)
    values: list[float] = []
    for begin in range(0, len(footage.frames), EFFORT.measured_frames):
        part = slice(begin, begin + EFFORT.measured_frames)
        pictures = backend.render(prepared, footage.taus[part], footage.size, footage.size)
        values += map(cv2.PSNR, pictures, footage.frames[part])
    return fmean(min(MAX_PSNR, value) for value in values)
