"""Quantiser steps of all attributes, from their sensitivities and one qscale."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.fit.tuned import RATE_CONTROL, STEPS
from gsvrcodec.model.attributes import ATTRIBUTES
from gsvrcodec.model.gop import GAUSSIAN_PARAMETERS, Gop
from gsvrcodec.model.quantise import Precision, Refined, Steps
from gsvrcodec.model.refinement import REFINED, Refinement, levels


def usual_qscale(pixels: int, gaussians: int, psnr: float) -> float:
    """The qscale at which quantisation costs 0.2 dB after tuning.

    Args:
        pixels: Pixels of all frames that show the GOP.
        gaussians: N.
        psnr: PSNR before quantisation, dB.
    """
    wanted = STEPS.usual_share * 255.0**2 / 10 ** (psnr / 10)
    costs = STEPS.unit * GAUSSIAN_PARAMETERS * gaussians / pixels
    return min(max(math.sqrt(wanted / costs), RATE_CONTROL.finest), RATE_CONTROL.coarsest)


def bit_worth(qscale: float) -> float:
    """Squared 8-bit codes that a bit has to save at a qscale: the slope of all steps."""
    return 2 * math.log(2) * STEPS.unit * qscale**2


def equal_slope_steps(sensitivities: Gop, qscale: float) -> Steps:
    """Steps of equal slope: the last bit of each plane buys the same quality.

    Rounding a sample to steps s costs s^2 / 12 times its sensitivity. One more bit a sample saves
    three quarters of that cost. So at the optimum the cost is the same for the samples of all
    planes, and the qscale sets it.

    Args:
        sensitivities: Squared error of a change of each parameter by one; see `sensitivities`.
        qscale: Factor of all steps; 1 is fine, 3 is coarse.
    """
    steps = {}
    for attribute in ATTRIBUTES:
        change = getattr(sensitivities, attribute.name).reshape(-1, attribute.components)
        mean = change.mean(axis=0, dtype=np.float64) if len(change) else np.ones(change.shape[1])
        if attribute.grid == "gaussians":
            # Components of an attribute differ by chance alone, or by the picture's aspect.
            mean = np.full(attribute.components, np.exp(np.log(np.maximum(mean, 1e-30)).mean()))
        coarser = STEPS.coarser.get(attribute.name, 1.0)
        wanted = coarser * qscale * np.sqrt(12 * STEPS.unit / np.maximum(mean, 1e-30))
        wanted = np.clip(wanted, STEPS.smallest, STEPS.largest[attribute.name])
        if attribute.name == "rotation":  # so that half a circle is a whole number of steps
            wanted = math.pi / np.round(math.pi / wanted)
        elif attribute.name == "indicator":  # so that 1 is a whole number of steps
            wanted = 2.0 ** np.round(np.log2(wanted))
        else:
            wanted = _short(wanted)
        steps[attribute.name] = tuple(wanted.tolist())
    return steps


def refined_steps(gop: Gop, sensitivities: Gop, qscale: float) -> Precision:
    """Steps of equal slope for each Gaussian: coarse ones, and bits for those that need them.

    Args:
        gop: The GOP to be stored; a key GOP.
        sensitivities: Squared error of a change of each parameter by one.
        qscale: Factor of all steps.
    """
    precision: dict[str, int | tuple[float, ...] | Refined] = {}
    precision.update(equal_slope_steps(sensitivities, qscale))
    if not len(gop):
        return precision
    moving = gop.linear.any(axis=1) | gop.quadratic.any(axis=1)
    plain = {name: np.array(precision[name]) for name in REFINED}
    costs = {
        name: getattr(sensitivities, name).reshape(len(gop), -1).mean(axis=1, dtype=np.float64)
        for name in REFINED
    }
    step = np.array(precision["log_opacity"], np.float32)
    log_opacity = np.rint(gop.log_opacity / step) * step
    log_scale = gop.log_scale
    for _ in range(STEPS.refinements):
        for name, own in levels(log_scale, log_opacity).items():
            counted = moving if name in ("linear", "quadratic") else slice(None)
            if not len(own[counted]):
                continue
            refinement, coarser = _best_refinement(costs[name][counted], own[counted])
            wanted = coarser * plain[name]
            if name == "rotation":
                wanted = math.pi / np.maximum(np.round(math.pi / wanted), 2)
            else:
                wanted = _short(wanted)
            precision[name] = Refined(tuple(wanted.tolist()), refinement)
            if name == "log_scale":  # levels follow from rounded values
                step = wanted.astype(np.float32)
                log_scale = np.rint(gop.log_scale / step) * step
    return precision


def _best_refinement(
    costs: NDArray[np.float64], own_levels: NDArray[np.int64]
) -> tuple[Refinement, float]:
    """The refinement that saves most bits at equal cost, and how much coarser its steps are.

    Steps grow by at most `STEPS.coarsest`.

    Args:
        costs: Sensitivity of each value, (N,).
        own_levels: Level of each Gaussian, (N,).
    """
    best = -math.inf, Refinement(), 1.0
    for least in range(int(own_levels.min()), int(own_levels.max()) + 1):
        refinement = Refinement(least, STEPS.most_refined)
        bits = refinement.bits(own_levels)
        left = (costs * 4.0**-bits).mean()
        coarser = math.sqrt(costs.mean() / left) if left > 0 else 1.0
        saved = math.log2(coarser) - bits.mean()
        if saved > best[0] and coarser <= STEPS.coarsest:
            best = saved, refinement, coarser
    return best[1:]


def _short(steps: NDArray[np.float64]) -> NDArray[np.float64]:
    """Steps of six binary digits, so that their multiples are exact in binary32."""
    digits, exponent = np.frexp(steps)
    return np.ldexp(np.round(digits * 64) / 64, exponent)
