"""How finely each parameter of a GOP is stored, for one factor of quality."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.fit.target import COARSEST, FINEST
from gsvrcodec.model.attributes import ATTRIBUTES
from gsvrcodec.model.gop import GAUSSIAN_PARAMETERS, Gop
from gsvrcodec.model.quantise import Steps

#: No step is larger than this, however little depends on the attribute.
_LARGEST: Mapping[str, float] = {
    "position": 1 / 64,
    "log_scale": 0.25,
    "rotation": math.pi / 8,
    "colour": 0.05,
    "indicator": 0.25,
    "linear": 1 / 64,
    "quadratic": 1 / 64,
    "xy": 0.5,
    "xt": 0.5,
    "yt": 0.5,
}
#: Nor smaller: positions all over a frame have to fit into 16 bits.
_SMALLEST = 6e-5
#: Squared 8-bit codes that rounding one parameter may cost over a whole GOP, at factor 1.
_UNIT = 100.0
#: Squared error of rounding, in that of the fit, that comes to 0.2 dB after fine-tuning.
_USUAL_SHARE = 0.06
#: What may be rounded more than equal slopes have it: what is rounded later makes up for it.
_COARSER = {"log_scale": 1.5}


def usual_factor(samples: int, gaussians: int, psnr: float) -> float:
    """The factor at which rounding costs 0.2 dB, fine-tuned.

    Args:
        samples: Pixels of all frames.
        gaussians: N.
        psnr: Quality before rounding, dB.
    """
    wanted = _USUAL_SHARE * 255.0**2 / 10 ** (psnr / 10)
    costs = _UNIT * GAUSSIAN_PARAMETERS * gaussians / samples
    return min(max(math.sqrt(wanted / costs), FINEST), COARSEST)


def equal_slope_steps(changes: Gop, factor: float) -> Steps:
    """Steps that make the last bit of each plane buy as much quality as that of any other.

    Rounding to steps s costs s^2 / 12 times what a change by one does; where steps are fine, one
    more bit a sample saves three quarters of that, so it has to be the same for all samples.

    Args:
        changes: Squared error of a change by one, as `sensitivity` measures it.
        factor: Of the steps; 1 is fine, 3 is coarse.
    """
    steps = {}
    for attribute in ATTRIBUTES:
        change = getattr(changes, attribute.name).reshape(-1, attribute.components)
        mean = change.mean(axis=0, dtype=np.float64) if len(change) else np.ones(change.shape[1])
        if attribute.grid == "gaussians":
            # Components of an attribute differ by chance alone, or by the picture's aspect.
            mean = np.full(attribute.components, np.exp(np.log(np.maximum(mean, 1e-30)).mean()))
        coarser = _COARSER.get(attribute.name, 1.0)
        wanted = coarser * factor * np.sqrt(12 * _UNIT / np.maximum(mean, 1e-30))
        wanted = np.clip(wanted, _SMALLEST, _LARGEST[attribute.name])
        if attribute.name == "rotation":  # half a circle is a whole number of steps
            wanted = math.pi / np.round(math.pi / wanted)
        elif attribute.name == "indicator":  # and one is
            wanted = 2.0 ** np.round(np.log2(wanted))
        else:
            wanted = _short(wanted)
        steps[attribute.name] = tuple(wanted.tolist())
    return steps


def _short(steps: NDArray[np.float64]) -> NDArray[np.float64]:
    """Steps of six binary digits: their multiples are exact, and nought is among them."""
    digits, exponent = np.frexp(steps)
    return np.ldexp(np.round(digits * 64) / 64, exponent)
