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
    #: rates of motion and of position offsets are px of the frame, and those of positions are px of
    #: the axes of a Gaussian of mean scale; otherwise they are halves of the frame
    in_pixels: bool
    #: steps of the longest fit that the rates suit; n times as many take rates / n^0.25
    rated_steps: float
    betas: tuple[float, float]  #: decay of Adam's two moments
    decay: Callable[[float], float]  #: factor of the rates, by the fraction of the effort spent
    warm_up: float  #: steps over which the rates grow to their full value; 1 = none
    coarse: float  #: fraction of the effort spent at half resolution
    relocations: tuple[float, ...]  #: fractions of the effort at which weak Gaussians move
    moving: float = 0.1  #: fraction of the Gaussians that moves each time
    #: factor of all rates of Gaussians that a predicted fit has not carried over
    new: float = 1.0
    #: what is added to the factor of a Gaussian's rates of motion where it moves fast
    fast: float = 0.0
    fast_px: float = 2.0  #: linear motion at which half of that is added, px of the frame
    settling: int = 0  #: fewest steps between two relocations; one that comes sooner is left out
    #: fractions of the effort at which Gaussians leave that are not worth their bits
    prunings: tuple[float, ...] = ()
    counted: float = 0.25  #: fraction of the effort before which their number stays as it is
    coarse_min_side: int = 128  #: smaller frames are fitted at full resolution only, px


def _falling(spent: float) -> float:
    return math.pow(1 - 0.98 * spent, 1.5)


def _falling_linearly(spent: float) -> float:
    return 1 - 0.98 * spent


def _cosine(spent: float) -> float:
    return 0.02 + 0.98 * (1 + math.cos(math.pi * spent)) / 2


#: Means, float PSNR of first GOPs of twelve clips at half size, 60 visits: linear x0.4 and
#: quadratic x0.2 +0.45 dB over the rates of sums; with position x0.75, opacity 0.12 instead of 0.2,
#: coarse 0.22 instead of 0.35 and smaller new Gaussians +0.53 dB. Around these values it is flat.
#:
#: What follows was measured with sums.
#:
#: Six clips (Bunny and those of `tests/benchmarks`), 48 frames at 0.1 bpp and 25 visits, gave
#: +0.73 dB in the mean, +0.34 to +1.1 dB by clip, over scale and rotation 0.08, colour 0.02, coarse
#: 0.5, relocations at 0.15, 0.3 and 0.45, and tuning of 0.12: `clips --table recipe`,
#: clips-recipe.json against clips-recipe-before.json.
#:
#: Bee, soccer, flower and Bunny, 16 frames at 0.06 to 0.12 bpp and 25 visits, gave +0.43 dB in
#: the mean of two seeds for what came after it: steps of positions along the axes of the Gaussians
#: (+0.15 dB); rates x1.4 that fall to the power of 1.5 instead of linearly, with a warm-up (+0.2
#: dB; without it flower loses 0.3 dB for good in its first 16 steps, by two of four seeds; x2 loses
#: 0.5 dB); beta2 0.9 instead of 0.95. Around these values it is flat: each attribute's rate x0.6
#: and x1.5, warm-up 4 and 16, coarse 0.25 and 0.5, 0.06 and 0.15 of the Gaussians moving cost up to
#: 0.2 dB. Steps of motion along the axes and of colours along luma and chroma win nothing.
#:
#: A fit of few steps leaves relocations out. 8 frames of six clips, 10 / 20 visits: 20 steps
#: between two of them gain 0.2 / 0.05 dB and take less time, 12 steps 0.1 / 0.1 dB; 20 steps and
#: 0.15 of the Gaussians moving 0.1 / -0.1 dB.
#:
#: Long fits take smaller rates. 24 frames at CRF 28, gain at equal size over preset medium with
#: rates / sqrt(n) from 700 / 1400 / 2800 steps on: slow 0.42 / 0.55 / 0.57 dB for bee, Bunny,
#: flower and soccer (Bunny 0.74 / 0.73 / 0.53), medium 0.04 / 0.12 / - (Bunny 0 / -0.25 / -);
#: slowest, flower, from 700 / 2000 steps on -0.14 / 0.57 dB. rates / n^0.25 from 700 steps on are
#: like those from 1000, 1570 and 2600 steps on at the three presets.
#:
#: Gaussians that are not worth their bits leave three times while there is effort left, each time
#: before or long after a relocation, for new ones are worth nothing yet. 24 frames at CRF 28 and 40
#: visits, at equal size over leaving at the end alone: +0.45 dB for bee, soccer, flower and drive
#: (+0.2 to +0.7 dB by clip); at 0.5, 0.65 and 0.8 +0.47 dB for six clips, and +0.15 dB for those
#: four at 1 s a frame. Once and twice were worth 0.23 and 0.36 dB, by 48 bits instead of 64.
MAIN = Recipe(
    rates={
        "position": 0.95,
        "log_scale": 0.235,
        "rotation": 0.235,
        "colour": 0.042,
        "log_opacity": 0.12,
        "indicator": 0.056,
        "linear": 0.2,
        "quadratic": 0.1,
        # Offsets of position and scale (px), rotation and log-opacity.
        "xy": (3.1, 3.1, 0.07, 0.07, 0.007, 0.007, 0.0, 0.0),
        "xt": 0.112,
        "yt": 0.112,
    },
    in_pixels=True,
    rated_steps=700,
    betas=(0.9, 0.9),
    decay=_falling,
    warm_up=8,
    coarse=0.22,
    relocations=(0.06, 0.12, 0.18, 0.24, 0.3, 0.36, 0.42, 0.48, 0.54, 0.6),
    settling=20,
    prunings=(0.53, 0.7, 0.85),
)

#: Predicted GOPs begin with a good picture. GOPs after the first of blocks, soccer, coffee, bee and
#: cup at half size, 60 visits, qscale 1, squared error and bits at one slope: all rates x0.7 and x1
#: over x0.5 +1.7 and +5.7 %, of new Gaussians alone -0.2 to -0.6 %; rates of scale and rotation
#: x0.3 -0.9 %; rates that fall linearly -0.9 %; a coarse stage of 0.1 and 0.22 over none +1.4 and
#: +3 %; rates of motion x4 where it is fast, and steps about the middle, -2.4 % (blocks -10 %: its
#: hands gain 1.3 dB; in key GOPs at full size +1 %); 10 % of new Gaussians at first, or each time,
#: +1.4 and +1 %. What is chosen, with the constants of `PREDICTION` and `PRICE`, over x0.5 of all
#: rates, a coarse stage of 0.22 and what is kept by frames of half the size: -10 %.
PREDICTED = replace(
    MAIN,
    rates={
        name: tuple(0.5 * r for r in rate)
        if isinstance(rate, tuple)
        else (0.3 if name in ("log_scale", "rotation") else 0.5) * rate
        for name, rate in MAIN.rates.items()
    },
    decay=_falling_linearly,
    coarse=0.0,
    relocations=(0.1, 0.2, 0.3),
    moving=0.05,
    new=2.0,
    fast=3.0,
)

#: The publication's rates; no coarse stage.
PAPER = Recipe(
    rates={
        **dict.fromkeys(("position", "log_scale", "rotation", "colour", "log_opacity"), 0.01),
        **dict.fromkeys(("indicator", "linear", "quadratic", "xy", "xt", "yt"), 0.0025),
    },
    in_pixels=False,
    rated_steps=math.inf,
    betas=(0.9, 0.999),
    decay=_cosine,
    warm_up=1,
    coarse=0.0,
    relocations=(),
)
