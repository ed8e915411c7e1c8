"""How to fit: options, learning rates and schedule."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

from gsvrcodec.render.backend import AdamRule

Deform = Literal["hybrid", "triplane", "polynomial"]
Flow = Literal["dis", "raft"]
Profile = Literal["main", "paper"]


@dataclass(frozen=True, slots=True, kw_only=True)
class FitOptions:
    """How GOPs are fitted."""

    deform: Deform = "hybrid"  #: parts of the deformation field in use
    flow: Flow = "dis"  #: optical flow that the Gaussians' motion starts from
    tune: bool = True  #: fine-tune under quantisation


@dataclass(frozen=True, slots=True)
class Recipe:
    """Learning rates and schedule. Rates are Adam's, in the units of the raw parameters."""

    rates: Mapping[str, float | tuple[float, ...]]  #: of each attribute, or of its components
    #: whether rates of motion and position offsets are px of the frame, those of positions px along
    #: the axes of a Gaussian of mean scale, and those of rotations of a round one; False = lengths
    #: are halves of the frame, and all turn alike
    in_pixels: bool
    rated_steps: float  #: longest fit at these rates, steps; one n times as long takes rates/n^0.25
    rule: AdamRule  #: how Adam steps; the tri-plane takes all of its steps
    decay: Callable[[float], float]  #: factor of the rates, by the fraction of the effort spent
    warm_up: float  #: steps over which the rates grow to their full value; 1 = none
    coarse: float  #: fraction of the effort at half resolution
    relocations: tuple[float, ...]  #: fractions of the effort at which weak Gaussians move
    moving: float = 0.1  #: fraction of the Gaussians that moves each time
    new: float = 1.0  #: rates of Gaussians that a predicted fit has not carried over / rates
    fast: float = 0.0  #: rates of motion of very fast Gaussians / rates - 1
    fast_px: float = 2.0  #: linear motion at which half of `fast` is added, px of the frame
    settling: int = 0  #: fewest steps between two relocations; one that comes sooner is left out
    prunings: tuple[float, ...] = ()  #: fractions of the effort at which dear Gaussians leave
    counted: float = 0.25  #: fraction of the effort before which the number of Gaussians stays
    ends: bool = True  #: whether the ends of a long GOP are shown more often


def _falling(spent: float) -> float:
    return 1 - 0.98 * spent


def cosine(spent: float) -> float:
    """Factor of the rates: 1 at the start, 0.02 in the end, falling as a cosine."""
    return 0.02 + 0.98 * (1 + math.cos(math.pi * spent)) / 2


#: Key GOPs; docs/tuning.md has what was tried. Around these values it is flat.
MAIN = Recipe(
    rates={
        "position": 0.95,
        "log_scale": 0.235,
        "rotation": 0.33,
        "colour": 0.042,
        "log_opacity": 0.17,
        "indicator": 0.078,
        "linear": 0.28,
        "quadratic": 0.14,
        # Offsets of position and scale (px), rotation and log-opacity.
        "xy": (3.1, 3.1, 0.07, 0.07, 0.007, 0.007, 0.0, 0.0),
        "xt": 0.112,
        "yt": 0.112,
    },
    in_pixels=True,
    rated_steps=700,
    rule=AdamRule((0.9, 0.9), agreeing=1.3, opposing=0.0),
    decay=_falling,
    warm_up=14,
    coarse=0.22,
    relocations=(0.06, 0.12, 0.18, 0.24, 0.3, 0.36, 0.42, 0.48, 0.54, 0.6),
    settling=20,
    prunings=(0.53, 0.7, 0.85),
)

#: Predicted GOPs, which begin with a good picture; docs/tuning.md has what was tried.
PREDICTED = replace(
    MAIN,
    rates={
        name: tuple(0.5 * r for r in rate)
        if isinstance(rate, tuple)
        else (0.3 if name in ("log_scale", "rotation") else 0.5) * rate
        for name, rate in MAIN.rates.items()
    },
    coarse=0.0,
    relocations=(0.1, 0.2, 0.3),
    moving=0.05,
    counted=0.28,
    prunings=(),
    new=2.0,
    fast=3.0,
)
