"""From a fit to what is stored of it, at any qscale."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.fit.adam import Adam
from gsvrcodec.fit.fitting import Fit, mean_psnr
from gsvrcodec.fit.footage import Footage
from gsvrcodec.fit.optimise import PACED_STEPS, Effort, Every, targets_of, visits
from gsvrcodec.fit.parameters import LOOK, MOTION, Anchor, Parameters
from gsvrcodec.fit.precision import (
    equal_slope_steps,
    refined_steps,
    sensitivities,
    sensitivities_of_motion,
    steps_of_predicted,
    still,
    usual_qscale,
    with_static,
    with_unchanged,
    with_usual_opacity,
    without_changes,
)
from gsvrcodec.fit.recipe import MAIN, Deform, FitOptions, Recipe
from gsvrcodec.fit.relocate import losses
from gsvrcodec.fit.target import Slope
from gsvrcodec.fit.tuned import STAGED
from gsvrcodec.model.gop import Float32Array, Gop
from gsvrcodec.model.quantise import Precision, dequantised, of_carried
from gsvrcodec.model.static import select_gaussians
from gsvrcodec.render.backend import Backend, Samples, Scalar

#: Attributes rounded together, in this order; the colours, which are in no stage, come last.
_STAGES = (
    ("indicator", "linear", "quadratic", "xy", "xt", "yt"),
    ("position",),
    ("log_scale", "rotation", "log_opacity"),
)


def quantise_in_stages(
    gop: Gop,
    precision: Precision,
    footage: Footage,
    recipe: Recipe,
    steps: int,
    seconds: float | None,
    rng: np.random.Generator,
    backend: Backend,
    *,
    deform: Deform = "hybrid",
    anchor: Anchor | None = None,
) -> Gop:
    """Return `gop` with all but the colours rounded, and colours tuned to make up for it.

    Gaussians overlap: attributes that are still free undo a part of the error that rounding
    another attribute makes. The quantisation loss falls by two fifths, at the same bits.

    Args:
        gop: the GOP to be stored.
        precision: steps or bits that it will be stored with.
        footage: frames to show.
        recipe: rates of the fit.
        steps: optimiser steps of all stages together, without `seconds`.
        seconds: wall time to spend; None = by steps.
        rng: order of the frames.
        backend: the renderer.
        deform: parts of the deformation field in use.
        anchor: what the GOP is relative to. Carried Gaussians without any change get none.
    """
    size, taus = footage.size, footage.taus
    carried = None if anchor is None else anchor.carried
    parameters = Parameters(gop, deform, backend, footage.background, anchor)
    if anchor is not None:
        parameters.freeze(anchor.carried & unchanged(gop))
    targets, behind = targets_of(parameters, footage.frames, size)
    order = visits(len(footage.frames), rng, ends=recipe.ends)
    each = max(1, steps // len(_STAGES)), None if seconds is None else seconds / len(_STAGES)

    def take(
        adam: Adam, look: bool, tau: Scalar, target: Samples, factor: Scalar, number: Scalar
    ) -> None:
        """Take a step on one frame; `look`: at axes anew."""
        tensors = parameters.tensors()
        gradients = parameters.gradients(tensors, tau, target, size, behind)
        parameters.hold(gradients)
        if look:
            adam.look(tensors)
        adam.step(gradients, factor, number)
        parameters.limit()

    for stage in _STAGES:
        rounded = dequantised(gop, precision, carried)
        gop = replace(gop, **{name: getattr(rounded, name) for name in stage})
        parameters.fix(stage, gop)
        adam, effort = Adam(parameters.raw, recipe, size, backend), Effort(*each)
        looking = Every(PACED_STEPS)
        taken = [backend.recorded(partial(take, adam, look)) for look in (False, True)]
        while (spent := effort.spent) < 1.0:
            index = next(order)
            how = float(taus[index]), targets[index], STAGED.rates * (1 - spent), effort.steps + 1
            taken[looking.due()](*how)
            effort.advance()
        gop = parameters.stored()
    return gop


def with_places_for(gop: Gop, precision: Precision, anchor: Anchor) -> Gop:
    """Make up for the rounding of motion that a predicted GOP is to be stored with.

    A Gaussian of which changes are stored anyway stays where it is in the middle of the GOP. The
    linear motion of another one makes up for its quadratic motion as well as it can.

    Args:
        gop: Stored values.
        precision: Steps that they will be stored with.
        anchor: What they are relative to.
    """
    start, steps = anchor.start, of_carried(precision)
    alone = (anchor.carried & unchanged(gop))[:, None]

    def error(name: str, value: Float32Array) -> NDArray[np.float64]:
        """What rounding adds to a motion."""
        step = np.array(steps[name])
        return np.asarray(np.rint(value / step) * step - value)

    curve = error("quadratic", gop.quadratic)
    # Of tau - start and tau^2 - start^2: their mean product / the mean square of the first.
    share = start * (start**2 - 1 / 3) / (start**2 + 1 / 3)
    linear = (gop.linear - share * alone * curve).astype(np.float32)
    way = start * error("linear", linear) + start**2 * curve
    way = way / anchor.units.position
    place = gop.position + (anchor.carried[:, None] & ~alone) * way
    return replace(gop, linear=linear, position=place.astype(np.float32))


def unchanged(gop: Gop) -> NDArray[np.bool_]:
    """Whether nothing changes in the stored look of each Gaussian, (N,)."""
    changes = [getattr(gop, name).reshape(len(gop), -1) for name in LOOK]
    return np.asarray(~np.concatenate(changes, axis=1).any(axis=1))


#: Bytes of a GOP at a precision: (gop, precision, exact) -> size; not exact = quick.
Measure = Callable[[Gop, Precision, bool], int]


@dataclass(frozen=True, slots=True, eq=False)
class Quantised:
    """What is stored of a GOP."""

    gop: Gop  #: values before the last rounding
    precision: Precision  #: steps or bits
    psnr: float  #: dB, mean of the frames that a decoder will show
    qscale: float | None  #: of the steps; None = bits


@dataclass(frozen=True, slots=True, eq=False)
class QuantisedFit:
    """A fit that can be stored at any qscale; implements `rate_control.Candidate`."""

    fit: Fit
    sensitivities: Gop
    options: FitOptions
    backend: Backend
    measure: Measure
    seed: tuple[int, ...]
    #: sensitivities of a predicted GOP if nothing moved, because Gaussians that have left the frame
    #: have none; None = a key GOP
    at_rest: Gop | None = None
    #: sensitivities of a predicted GOP if its places make up for changes of motion
    in_place: Gop | None = None
    #: sensitivities of a predicted GOP if what is carried over did not change
    unchanged: Gop | None = None
    #: what Gaussians of a key GOP have to be worth; None = all are stored
    slope: Slope | None = None
    losses: NDArray[np.float64] | None = None  #: (N,) squared error that is added without each

    @property
    def psnr(self) -> float:
        """PSNR before quantisation, dB."""
        return self.fit.psnr

    @property
    def usual_qscale(self) -> float:
        """The qscale at which quantisation costs 0.2 dB."""
        return usual_qscale(self.fit.footage.pixels, len(self.fit.gop), self.fit.psnr)

    def size(self, qscale: float, *, exact: bool = False) -> int:
        """Bytes at a qscale, before tuning; not `exact` = by the quick choice of codecs."""
        return self.measure(*self._stored(qscale), exact)

    def quality(self, qscale: float) -> float:
        """PSNR at a qscale before tuning, dB."""
        return self._psnr(*self._stored(qscale))

    def quantised(self, qscale: float, *, trials: int = 1) -> Quantised:
        """Round and tune; `trials` calls share a wall time."""
        gop, precision = self._stored(qscale)
        if (tuning := self.fit.tuning) is not None:
            gop = quantise_in_stages(
                gop,
                precision,
                self.fit.footage,
                MAIN,
                round(tuning.steps),
                None if tuning.seconds is None else tuning.seconds / trials,
                np.random.default_rng((*self.seed, 1)),
                self.backend,
                deform=self.options.deform,
                anchor=self.fit.anchor,
            )
        return Quantised(gop, precision, self._psnr(gop, precision), qscale)

    def stored_bytes(self, result: Quantised) -> int:
        """Bytes of what `quantised` returned."""
        return self.measure(result.gop, result.precision, True)

    def _stored(self, qscale: float) -> tuple[Gop, Precision]:
        """What is stored, and how finely."""
        states = [own for own in (self.sensitivities, self.at_rest) if own is not None]
        gop, anchor = with_static(self.fit.gop, states, qscale), self.fit.anchor
        new = np.ones(len(gop), np.bool_) if anchor is None else ~anchor.carried
        gop = with_usual_opacity(gop, new, self.sensitivities, qscale)
        if anchor is not None:
            return self._stored_changes(gop, anchor, qscale)
        costs = self.sensitivities
        if self.slope is not None and self.losses is not None:
            moving = np.asarray(gop.linear.any(axis=1) | gop.quadratic.any(axis=1))
            chosen = self.slope.at(qscale).worthwhile(self.losses, moving)
            gop, costs = select_gaussians(gop, chosen), select_gaussians(costs, chosen)
        return gop, refined_steps(gop, costs, qscale)

    def _stored_changes(self, gop: Gop, anchor: Anchor, qscale: float) -> tuple[Gop, Precision]:
        """What a predicted GOP stores, and how finely."""
        assert self.in_place is not None
        assert self.unchanged is not None
        steps = equal_slope_steps(self.sensitivities, qscale)
        states = self.sensitivities, self.unchanged
        gop = with_unchanged(gop, anchor.carried, states, steps, qscale)
        # Where no change of a place is stored, none can make up for rounded motion.
        alone = (anchor.carried & unchanged(gop))[:, None]
        motion = {
            name: np.where(alone, getattr(self.sensitivities, name), getattr(self.in_place, name))
            for name in MOTION
        }
        costs = replace(self.in_place, **motion)
        precision = steps_of_predicted(gop, costs, anchor.carried, qscale)
        return with_places_for(gop, precision, anchor), precision

    def _psnr(self, gop: Gop, precision: Precision) -> float:
        carried = None if self.fit.anchor is None else self.fit.anchor.carried
        decoded = self.fit.drawn(dequantised(gop, precision, carried))
        return mean_psnr(decoded, self.fit.footage, self.backend)


def quantisable(
    fit: Fit,
    options: FitOptions,
    backend: Backend,
    measure: Measure,
    *,
    seed: tuple[int, ...],
    slope: Slope | None = None,
) -> QuantisedFit:
    """Measure the sensitivities of a fit, so that it can be stored at any qscale.

    With a slope, Gaussians of a key GOP that are not worth their bits are left out.
    """
    rng, gop = np.random.default_rng(seed), fit.drawn(fit.gop)
    at_rest = in_place = as_before = None
    if fit.anchor is None:
        found = sensitivities(fit.footage, gop, rng, backend)
    else:
        of_motion = partial(sensitivities_of_motion, fit.footage, anchor=fit.anchor)
        found, in_place = of_motion(gop, rng, backend)
        at_rest, _ = of_motion(fit.drawn(still(fit.gop)), rng, backend, frames=2)
        before = fit.drawn(without_changes(fit.gop, fit.anchor.carried))
        as_before = sensitivities(fit.footage, before, rng, backend, frames=2)
        costs = fit.anchor.costs
        found, in_place, at_rest, as_before = map(costs, (found, in_place, at_rest, as_before))
    added = losses(gop, fit.footage, backend) if slope is not None and fit.anchor is None else None
    states = at_rest, in_place, as_before
    return QuantisedFit(fit, found, options, backend, measure, seed, *states, slope, added)
