"""Quantiser steps of all attributes, from their sensitivities and one qscale."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.fit.tuned import RATE_CONTROL, STEPS
from gsvrcodec.model.attributes import ATTRIBUTES
from gsvrcodec.model.gop import GAUSSIAN_PARAMETERS, Gop
from gsvrcodec.model.quantise import Steps


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


def _short(steps: NDArray[np.float64]) -> NDArray[np.float64]:
    """Steps of six binary digits, so that their multiples are exact in binary32."""
    digits, exponent = np.frexp(steps)
    return np.ldexp(np.round(digits * 64) / 64, exponent)
