"""Constants of a fit that were found by trying, by topic. The optimiser's are in `recipe`.

Each topic says what it was measured on. "Six clips" are Bunny and those of
`tests/benchmarks/clips.py`; "Bunny" is the benchmark clip alone, so that other video may want
another value.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class _Effort:
    """Steps and time of a fit."""

    #: visits of each frame, by preset. Medium takes 0.5 to 1 s a frame of 720p at CRF 26: Bunny,
    #: bee, flower, soccer on 2 cores. 24 frames of them at CRF 28, 10 / 15 / 20 / 25 visits: 5.3 /
    #: 3.2 / 2.1 / 1.4 dB worse than medium at equal size, in 0.38 / 0.43 / 0.5 / 0.53 of its time,
    #: of which 0.33 go by before the first step and after the last
    frame_visits: Mapping[str, int] = field(
        default_factory=lambda: {
            "fastest": 20,
            "medium": 60,
            "slow": 150,
            "slowest": 400,
        }
    )
    #: a GOP of fewer frames takes as many steps as one of so many. 24 frames at CRF 28 and preset
    #: fast, 1 / 8 / 12: driving, GOPs of 6, 29.4 dB at 0.105 bpp / 30.3 at 0.098 / 32.2 at 0.109 in
    #: 0.86 / 0.93 / 1.21 s a frame; bee, GOPs of 8, 31.8 / 32.6 / 33.4 dB at 0.065 bpp in 0.33 /
    #: 0.40 / 0.46 s a frame. Medium: driving 32.4 dB at 0.106 bpp / 32.7 at 0.104 / 33.2 at 0.094
    least_frames: int = 12
    least_steps: int = 100  #: of a fit
    least_tuning_steps: int = 30  #: of all stages of the quantisation together
    #: wall time that packing takes from a budget: seconds for each Gaussian, at most a fraction
    packing_seconds: float = 70e-6
    packing_share: float = 0.4
    qat_from: float = 0.9  #: fraction of the effort after which `paper` fits quantised values
    measured_frames: int = 8  #: frames rendered together to measure a PSNR


@dataclass(frozen=True, slots=True)
class _Start:
    """Where Gaussians start. Bunny."""

    gradient_share: float = 0.7  #: fraction of the Gaussians spread by gradient, the rest evenly
    spread: float = 0.45  #: standard deviation of a Gaussian, in distances to its neighbours
    sigma_range: tuple[float, float] = (0.6, 20.0)  #: px
    hole_share: float = 0.2  #: most Gaussians that start in the first frame, and in the last
    hole_px: int = 9  #: box size of the coverage, px
    covered: float = 0.6  #: sum of weights at which a place needs no more Gaussians; usual is 1.3
    indicator: float = 0.88  #: dynamic indicator of all
    plane_noise: float = 0.0025  #: standard deviation of the spatial grid


@dataclass(frozen=True, slots=True)
class _Tracks:
    """Points followed by optical flow. Bunny."""

    flow_height: int = 480  #: most rows of the frames that flow is estimated between
    #: A step is doubted when the way there and back misses by more than this (px^2), or by more
    #: than this fraction of the squared lengths of both.
    miss_px2: float = 0.5
    miss_share: float = 0.01
    doubted: float = 0.3  #: factor of the trust after a doubted step, or a step out of the frame
    #: regularisation that keeps at rest what the tracks hardly determine: the bend of two frames,
    #: frames at nearly the same time, points that are lost at once
    ridge: float = 1e-3


@dataclass(frozen=True, slots=True)
class _Opacity:
    """Opacities."""

    #: greatest log-opacity, and least below zero. More makes edges hardly sharper, and a plane
    #: holds values of at most half the bounds of the specification at any step: Bunny lost 4.4 dB
    #: where one in twenty Gaussians had 9 to 12. Seven clips at full size, 5.5 / 4 / 3 in place
    #: of 12: 0.9 / 0.5 / 0.9 % less squared error and bits at one slope
    most: float = 5.5


@dataclass(frozen=True, slots=True)
class _Relocation:
    """Weak Gaussians moved to where the error is. Six clips, 0.1 bpp, 25 visits.

    A share of 0.05 or 0.15 costs 0.1 dB.
    """

    frames: int = 5  #: frames whose error is looked at
    sigma_range: tuple[float, float] = (0.4, 2.0)  #: px, of a Gaussian that has moved
    error_box_px: int = 3  #: box size of the squared error, px
    #: opacity of a Gaussian that has moved, in the sum of weights there; but at least 1
    weight: float = 0.4


@dataclass(frozen=True, slots=True)
class _Effect:
    """What a picture would lose without a Gaussian."""

    frames: int = 3  #: frames that are looked at
    #: greatest share of the weights, where one Gaussian has them all: of its effect, and of the
    #: error that is added, which its sensitivity tells less surely
    most_share: float = 0.9999
    most_lost: float = 0.95


@dataclass(frozen=True, slots=True)
class _Prediction:
    """Predicted fits."""

    frames: int = 8  #: frames that the worth of a change is measured in
    draws: int = 6  #: noises that sensitivities are measured with there
    floor: float = 0.05  #: least sensitivity, in the mean of all Gaussians
    #: a Gaussian is kept if its change is worth less than so many bits: what is kept costs nothing,
    #: does not flicker from GOP to GOP, and leaves the steps to the others. Squared error and bits
    #: as for `recipe.PREDICTED`, in full frames, over 500 bits in frames of half the size: 60 / 120
    #: / 250 / 500 / 1000 -2.3 / -3.9 / -2.1 / -2.1 / -1.6 %; soccer and blocks, where little moves,
    #: take a third fewer bits. Where a size is to be met, 60 over 130: soccer, 40 frames at 0.1
    #: bpp, takes 98 instead of 85 % of it, +0.05 dB; bee and blocks at 0.08 bpp 0 and -0.3 dB
    kept_bits: float = 130.0
    #: most factor of this if the wall time does not suffice for more changes. 36 frames of soccer
    #: at 0.33 bpp: 20k of 137k Gaussians change instead of 69k, and the GOP after the key GOP is at
    #: most 0.5 dB below it instead of 2.6 dB
    hurried: float = 10.0
    change_bits: float = 2.0  #: of a change, beside those of its components
    undone: float = 1.5  #: a change is undone if it is worth less than so many times its bits
    renewed_first: float = 0.05  #: fraction of the Gaussians that is new from the beginning
    least_steps: int = 60
    #: PSNR of the start, dB, below which a GOP is not predicted, if it is also so much below the
    #: reference: the optical flow has lost it. Full size, 34 visits: bunny starts at 25 dB and
    #: gains 1.8 dB at equal bits by prediction, bee at 22 dB and 0.3 dB, driving at 18.5 dB and
    #: loses 1.6 dB. cup, at a third of a second a frame, goes on at 20 dB: +0.2 dB
    lost: float = 19.0
    lost_fall: float = 8.0


@dataclass(frozen=True, slots=True)
class _Price:
    """Prices of bits during a fit, in what a bit is worth.

    First GOPs of soccer (two sizes), Bunny, blocks, drive, bee and coffee at half size, qscale 1
    and 2, dB at equal bytes over no price and opacities that follow the weights: opacity alone
    +0.2 and +0.4; with scales +0.25 and +0.5; with scales and motion +0.35 and +0.6; colours of new
    Gaussians 0 to -0.1. Opacities that stay at 1 are as good in the mean, and 0.6 dB worse for
    blocks, where hands pass over a mat.

    Changes at 1.2 / 3.6 over 2.4 +1.9 / -1.1 % of squared error and bits, at 3.2 -0.8 %, as for
    `recipe.PREDICTED`.
    """

    change: float = 3.0  #: of what a carried Gaussian changes
    motion: float = 2.2  #: of motion that differs from the neighbours'
    log_opacity: float = 4.0  #: of a new Gaussian's opacity that is not 1
    log_scale: float = 0.4  #: of a new Gaussian's scales that differ from the neighbours'
    near: int = 15  #: neighbours in drawing order
    steps: int = 4  #: optimiser steps that take the same slopes of prices
    #: qscale that bits are priced for, where the fit does not know the qscale
    qscale: float = 0.7


@dataclass(frozen=True, slots=True)
class _Steps:
    """Quantiser steps by equal slopes. Bunny at 0.01 to 0.1 bpp; bunny-rate-2s.json."""

    #: largest step, however little depends on the attribute
    largest: Mapping[str, float] = field(
        default_factory=lambda: {
            "position": 1 / 64,
            "log_scale": 0.25,
            "rotation": math.pi / 8,
            "colour": 0.05,
            "log_opacity": 1.0,
            "indicator": 0.25,
            "linear": 1 / 64,
            "quadratic": 1 / 64,
            "xy": 0.5,
            "xt": 0.5,
            "yt": 0.5,
        }
    )
    smallest: float = 6e-5  #: positions all over a frame have to fit into 16 bits
    #: squared 8-bit codes that rounding one parameter costs over a whole GOP, at qscale 1
    unit: float = 100.0
    #: squared error of rounding, in that of the fit, which costs 0.2 dB after tuning
    usual_share: float = 0.05
    #: factor of the equal-slope step: attributes rounded later make up for this one
    coarser: Mapping[str, float] = field(default_factory=lambda: {"log_scale": 1.5})
    frames: int = 8  #: frames that sensitivities are measured in
    most_refined: int = 3  #: most bits by which a Gaussian is finer than others
    #: times that refinements are chosen: each time by levels of values as rounded by the last
    refinements: int = 2
    #: most that the steps of base values are coarser than those of values without refinement. Six
    #: clips as in `PRICE`: 4 instead of 2.8 or no bound, +0.1 dB at equal bytes
    coarsest: float = 4.0
    #: squared 8-bit codes that the motion of a static Gaussian may be worth at qscale 1: what some
    #: ten bits buy elsewhere, at the slope of the steps (2 ln 2 times `unit` for each)
    static_worth: float = 1500.0
    #: bits that an opacity has to be worth; else it is stored as 1
    opacity_bits: float = 10.0


@dataclass(frozen=True, slots=True)
class _Slope:
    """How many Gaussians a slope is worth. Six clips at CRF 28, 24 frames, 25 visits."""

    #: power by which the squared error falls with the number of Gaussians
    fall: float = 0.7
    #: bits that one of them takes, and has to be worth. It is as good to ask for 90, for smaller
    #: files of less quality; 48 and 32 cost 0.08 and 0.2 dB at equal size
    gaussian_bits: float = 64.0
    #: more of them are worth it in a longer fit, by this power, for their error is looked at while
    #: the fit goes on. Preset slow, gain over medium at equal size, 0 / 0.2: flower 0.06 / 0.23 dB,
    #: soccer 0.04 / 0.4, bee 0.3 / 0.3, Bunny 0.75 / 0.75; medium gains 0.04 dB in their mean
    growth: float = 0.2
    steps: float = 600.0  #: of a fit with the number above
    #: power of what a GOP lasts by which its steps are finer. First GOPs of chains, squared error
    #: and bits at one slope, 0.2 / 0.45 over 0: soccer -3.4 / -3.8 %, blocks -2.4 / -2.3 %
    lasting: float = 0.3


@dataclass(frozen=True, slots=True)
class _Staged:
    """Staged quantisation.

    First GOPs of soccer, Bunny, blocks, drive, bee and coffee at half size, qscale 1 and 2, dB at
    equal bytes over an effort of 0.08 and rates of 0.024: rates of 0.05 0 and +0.15, 0.1 -0.3 and
    +0.1; effort of 0.12 with rates of 0.05 +0.1 and +0.2, 0.2 0 and +0.2.
    """

    effort: float = 0.12  #: fraction of the effort that goes into tuning
    rates: float = 0.05  #: factor of the recipe's rates at the beginning of a stage


@dataclass(frozen=True, slots=True)
class _RateControl:
    """Meeting a size or a quality. Bunny and the samples; `loss_left` as the rates of `STAGED`."""

    octave: float = 2.3  #: dB gained by twice as many Gaussians
    pilot: float = 1 / 6  #: fraction of the effort of the pilot fit, which tells the number
    #: pilot deficit: 119 * steps**-0.65 dB below a whole fit
    deficit: tuple[float, float] = (119.0, -0.65)
    rounding_loss: float = 0.4  #: dB lost by rounding at sensible steps
    #: PSNR before rounding that suits a target, beyond `rounding_loss`, dB; outside of it there is
    #: another fit, which aims at the middle, but no more than `refits`
    spare: tuple[float, float] = (-0.2, 0.8)
    refits: int = 4
    loss_left: float = 0.5  #: fraction of the quantisation loss left after tuning, at first
    tunings: int = 4  #: most trials of the qscale with tuning
    near: float = 0.04  #: dB by which a quality may be missed
    size_room: float = 0.003  #: fraction of a size kept free for what tuning may add
    size_power: float = 0.6  #: a size falls by the qscale to the power of minus this
    #: factor by which the qscale may differ from the usual one of a key GOP, and from that of the
    #: reference, where a size need not be met exactly
    key_reach: float = 1.4
    reach: float = 2.0
    #: size in that asked for, above which the qscale may differ by any factor. Too many bytes taken
    #: by each GOP left one Gaussian for the last of ten, and 12 dB: cup, 96 frames at 0.015 bpp
    excess: float = 1.2
    #: qscale of a key GOP whose chain has a size to meet, in the usual one
    coarser_key: float = 2.0
    #: where a size is to be met, the finest qscale, in the usual one: it costs 0.05 dB
    finest_usual: float = 0.5
    #: range of the qscale
    finest: float = 0.1
    coarsest: float = 16.0


EFFORT = _Effort()
START = _Start()
TRACKS = _Tracks()
OPACITY = _Opacity()
RELOCATION = _Relocation()
EFFECT = _Effect()
PRICE = _Price()
PREDICTION = _Prediction()
STEPS = _Steps()
SLOPE = _Slope()
STAGED = _Staged()
RATE_CONTROL = _RateControl()
