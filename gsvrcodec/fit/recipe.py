"""Learning rates and schedule of the optimiser."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace


@dataclass(frozen=True, slots=True)
class Recipe:
    """Learning rates and schedule. Rates are Adam's, in the units of the raw parameters."""

    #: rate of each attribute, or of each of its components
    rates: Mapping[str, float | tuple[float, ...]]
    #: rates of positions and of position offsets are px of the frame, not halves of the frame
    in_pixels: bool
    #: steps of the longest fit that the rates suit; n times as many steps take rates / sqrt(n)
    rated_steps: float
    betas: tuple[float, float]  #: decay of Adam's two moments
    decay: Callable[[float], float]  #: factor of the rates, by the fraction of the effort spent
    coarse: float  #: fraction of the effort spent at half resolution
    relocations: tuple[float, ...]  #: fractions of the effort at which weak Gaussians move
    moving: float = 0.1  #: fraction of the Gaussians that moves each time
    coarse_min_side: int = 128  #: smaller frames are fitted at full resolution only, px


def _linear(spent: float) -> float:
    return 1 - 0.98 * spent


def _cosine(spent: float) -> float:
    return 0.02 + 0.98 * (1 + math.cos(math.pi * spent)) / 2


#: Rates of positions, motion and tri-plane were found on Bunny alone; the other rates, the betas,
#: the coarse stage and the relocations on six clips (Bunny and those of `tests/benchmarks`), 48
#: frames at 0.1 bpp and preset fast: +0.73 dB in the mean, +0.34 to +1.1 dB by clip, over scale
#: and rotation 0.08, colour 0.02, beta2 0.98, coarse 0.5, relocations at 0.15, 0.3 and 0.45, and
#: tuning of 0.12. `clips --table recipe`: clips-recipe.json against clips-recipe-before.json.
#: Relocations looked at full frames in that run; at half size they give 0.04 dB less and take half
#: the time.
MAIN = Recipe(
    rates={
        "position": 0.9,
        "log_scale": 0.168,
        "rotation": 0.168,
        "colour": 0.03,
        "indicator": 0.04,
        "linear": 0.36,
        "quadratic": 0.36,
        # Offsets of position and scale (px), rotation and colour.
        "xy": (2.2, 2.2, 0.05, 0.05, 0.005, 0.005, 0.005, 0.005),
        "xt": 0.08,
        "yt": 0.08,
    },
    in_pixels=True,
    rated_steps=700,
    betas=(0.9, 0.95),
    decay=_linear,
    coarse=0.35,
    relocations=(0.06, 0.12, 0.18, 0.24, 0.3, 0.36, 0.42, 0.48, 0.54, 0.6),
)

#: Predicted GOPs begin with a good picture.
PREDICTED = replace(
    MAIN,
    rates={
        name: tuple(0.5 * r for r in rate) if isinstance(rate, tuple) else 0.5 * rate
        for name, rate in MAIN.rates.items()
    },
    relocations=(0.1, 0.2, 0.3),
    moving=0.05,
)

#: The publication's rates; no coarse stage.
PAPER = Recipe(
    rates={
        **dict.fromkeys(("position", "log_scale", "rotation", "colour"), 0.01),
        **dict.fromkeys(("indicator", "linear", "quadratic", "xy", "xt", "yt"), 0.0025),
    },
    in_pixels=False,
    rated_steps=math.inf,
    betas=(0.9, 0.999),
    decay=_cosine,
    coarse=0.0,
    relocations=(),
)
