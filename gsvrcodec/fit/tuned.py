"""Constants of a fit that were found by trying, by topic; the optimiser's are in `recipe`.

docs/tuning.md has what was tried for each, on which clips, and what it gave.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class _Effort:
    """Steps and time of a fit."""

    #: visits of each frame, by preset
    frame_visits: Mapping[str, int] = field(
        default_factory=lambda: {
            "fastest": 20,
            "medium": 60,
            "slow": 150,
            "slowest": 400,
        }
    )
    least_frames: int = 12  #: a GOP of fewer frames takes as many steps as one of so many
    still_frames: int = 6  #: one frame, which has no motion to find, takes as many as so many
    least_steps: int = 100  #: of a fit
    long_gop: int = 12  #: frames from which on the ends of a GOP are shown more often
    ends_every: int = 2  #: rounds of all frames after which its ends are shown once more
    least_tuning_steps: int = 30  #: of all stages of the quantisation together
    #: wall time that packing takes, and more where a size or a quality is searched for; seconds for
    #: each Gaussian
    packing_seconds: float = 25e-6
    search_seconds: float = 45e-6
    packing_share: float = 0.4  #: most of that / wall time of the GOP
    qat_from: float = 0.9  #: fraction of the effort after which `paper` fits quantised values
    measured_frames: int = 8  #: frames rendered together to measure a PSNR


@dataclass(frozen=True, slots=True)
class _Start:
    """Where Gaussians start."""

    gradient_share: float = 0.7  #: fraction of the Gaussians spread by gradient, the rest evenly
    differing_share: float = 0.95  #: the same in front of a plate, by how far frames differ from it
    spread: float = 0.45  #: standard deviation of a Gaussian, in distances to its neighbours
    sigma_range: tuple[float, float] = (0.6, 20.0)  #: px
    hole_share: float = 0.2  #: most Gaussians that start in the first frame, and in the last
    hole_px: int = 9  #: box size of the coverage, px
    covered: float = 0.6  #: sum of weights at which a place needs no more Gaussians; usual is 1.3
    indicator: float = 0.88  #: dynamic indicator of all
    plane_noise: float = 0.0025  #: standard deviation of the spatial grid
    plate_noise: float = 9.0  #: difference from a plate that asks for no Gaussian, 8-bit codes


@dataclass(frozen=True, slots=True)
class _Plate:
    """Plates of key GOPs."""

    least_frames: int = 2  #: of a GOP or chain: a plate shows what stays
    lasting_frames: int = 6  #: of a chain, from which on what stands still lasts
    frames: int = 18  #: most frames of a chain that are compared
    box_px: int = 7  #: side of a box in which frames are compared, px
    differing: int = 8  #: difference that is no noise, 8-bit codes
    part_px: int = 15  #: side of a box in which a plate shows the same frame, px of half the size
    plain: float = 2.0  #: what a smooth place is worth in a plate / mean difference in a texture
    usual: float = 0.7  #: share of the frames in which a place that stands still is as usual
    still: float = 0.75  #: share of the detail of the picture that stands still, in what lasts
    mostly: float = 0.45  #: the same, of what has texture, or takes many bits
    textured: float = 3.0  #: mean difference in a texture, 8-bit codes
    #: the same, in a chain that has the plate of the one before, or in a later key GOP of a chain
    kept: float = 0.2
    #: difference of a frame from a plate that it shows / from its own means, at most
    nearer: float = 1.1
    drifting_px: float = 0.75  #: motion of what seems to stand still from which it does not, px
    drift_steps: int = 3  #: most steps of the search for that motion
    least_bits: float = 1.0  #: bits a pixel below which Gaussians do better, but for what lasts
    #: the same for what lasts: a plate may not expand to more than the format allows
    empty_bits: float = 0.01
    gaussians: float = 0.2  #: of those of a first guess, that a fit begins with in front of a plate
    left: float = 0.15  #: of these, that it ends with
    finer: float = 0.8  #: qscale of the Gaussians in front of a plate / that of others
    #: of Gaussians that repair the plate, which stay, / detail of the picture
    repairs: float = 0.01
    #: error that comes by showing one chain more / worth of the bits of another plate, at most
    aged: float = 0.6
    #: bits that Gaussians take where a plate does not show what is there / bits of the plate there
    repair: float = 2.0
    slower: float = 10.0  #: time that AV1 takes / that of its quick speed
    most_time: float = 0.16  #: share of a wall time that AV1 may take; else it is quick
    #: squared 8-bit codes that a bit saves at a quality of AV1
    saves: Mapping[float, float] = field(
        default_factory=lambda: {
            97: 0.22,
            95: 0.48,
            92.5: 0.8,
            89.5: 1.35,
            86: 2.1,
            81.5: 3.2,
            76: 5.5,
            69.5: 8.4,
            62: 13.7,
            54: 27.0,
            45: 57.0,
            35: 115.0,
            25: 250.0,
            15: 570.0,
            7.5: 1400.0,
            3.5: 2450.0,
            1: 4100.0,
        }
    )


@dataclass(frozen=True, slots=True)
class _TriPlane:
    """Size of the tri-plane."""

    cell_px: float = 20.0  #: side of a cell, px of the coded frame
    cells: tuple[int, int] = (4, 64)  #: fewest and most cells of a side
    share: float = 0.04  #: cap on numbers of a tri-plane / numbers of the Gaussians expected


@dataclass(frozen=True, slots=True)
class _Tracks:
    """Points followed by optical flow."""

    flow_height: int = 480  #: most rows of the frames that flow is estimated between
    finest_scale: int = 1  #: halvings of these frames that DIS still looks at
    descents: int = 12  #: steps of DIS for each of its patches
    median_px: int = 5  #: side of the median of its field, pixels
    #: a step is doubted when the way there and back misses by more than either of these
    miss_px2: float = 0.5  #: squared miss, px^2
    miss_share: float = 0.01  #: squared miss / squared lengths of both ways
    doubted: float = 0.3  #: factor of the trust after a doubted step, or a step out of the frame
    ridge: float = 1e-3  #: regularisation of motion that the tracks hardly determine


@dataclass(frozen=True, slots=True)
class _Opacity:
    """Opacities."""

    most: float = 5.5  #: greatest magnitude of a log-opacity in a fit


@dataclass(frozen=True, slots=True)
class _Relocation:
    """Weak Gaussians moved to where the error is."""

    frames: int = 3  #: frames whose error is looked at
    sigma_range: tuple[float, float] = (0.4, 2.0)  #: px, of a Gaussian that has moved
    error_box_px: int = 3  #: box size of the squared error, px
    weight: float = 0.4  #: opacity of a Gaussian that has moved / sum of weights there; at least 1


@dataclass(frozen=True, slots=True)
class _Effect:
    """What a picture would lose without a Gaussian."""

    frames: int = 3  #: frames that are looked at


@dataclass(frozen=True, slots=True)
class _Prediction:
    """Predicted fits."""

    frames: int = 8  #: frames that the worth of a change is measured in
    draws: int = 6  #: noises that sensitivities are measured with there
    floor: float = 0.05  #: least sensitivity / mean sensitivity of all Gaussians
    kept_bits: float = 130.0  #: worth of a change below which a Gaussian is kept as it is, bits
    #: the same where the source stands still and is as before / `kept_bits`
    still_worth: float = 8.0
    hurried: float = 10.0  #: cap on the multiplier of `kept_bits` under a time budget
    change_bits: float = 2.0  #: of a change, beside those of its components
    undone: float = 1.5  #: worth of a change / worth of its bits below which it is undone
    renewed_first: float = 0.05  #: new Gaussians at the beginning / all
    least_steps: int = 60
    kept: float = 0.6  #: share that stays as it is below which a slope has no predicted GOP
    #: Gaussians that change, by the slope / as many as it calls for in a key GOP; at the beginning
    #: at least so many, by the error that is there
    numbers: float = 0.8
    begun: float = 0.12
    #: a GOP is not predicted if its start is below `lost`, and so much below its reference, unless
    #: so many of its Gaussians are kept as they are
    still: float = 0.5  #: share
    lost: float = 20.0  #: PSNR, dB
    lost_fall: float = 8.0  #: dB


@dataclass(frozen=True, slots=True)
class _Moving:
    """Where the source moves in a GOP."""

    box_px: int = 7  #: that the variance over time is averaged in
    #: bits that motion takes for a pixel, and has to be worth, in a key GOP and in a predicted one
    key_bits: float = 0.08
    predicted_bits: float = 0.25
    share: float = 0.5  #: of a Gaussian's box below which it has no motion


@dataclass(frozen=True, slots=True)
class _Tiles:
    """Steps of a predicted fit that look at parts of a frame."""

    mean: float = 0.65  #: mean share of the steps that looks at a tile
    least: float = 0.3  #: least share


@dataclass(frozen=True, slots=True)
class _Price:
    """Prices during a fit: price of a bit / what it is worth at the qscale."""

    change: float = 3.0  #: of what a carried Gaussian changes
    motion: float = 2.2  #: of motion that differs from the neighbours'
    log_opacity: float = 4.0  #: of a new Gaussian's opacity that is not 1
    log_scale: float = 0.4  #: of a new Gaussian's scales that differ from the neighbours'
    near: int = 15  #: neighbours in drawing order
    steps: int = 4  #: optimiser steps that take the same slopes of prices
    qscale: float = 0.7  #: that bits are priced for where the qscale is not known yet


@dataclass(frozen=True, slots=True)
class _Steps:
    """Quantiser steps by equal slopes."""

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
    unit: float = 100.0  #: cost of rounding one parameter at qscale 1, squared 8-bit codes a GOP
    usual_share: float = 0.05  #: squared error of rounding / that of the fit, at the usual qscale
    #: step / equal-slope step: attributes rounded later make up for these
    coarser: Mapping[str, float] = field(default_factory=lambda: {"log_scale": 1.5})
    frames: int = 8  #: frames that sensitivities are measured in
    #: most bits by which a Gaussian is finer than others; of its rotation, which for slender ones
    #: has to be finer by far
    most_refined: int = 3
    most_turned: int = 8
    #: times that refinements are chosen: each time by levels of values as rounded by the last
    refinements: int = 2
    #: cap on steps of base values / steps without refinement; that of rotations has none
    coarsest: float = 4.0
    #: worth of motion at qscale 1 below which a Gaussian is static, squared 8-bit codes: ten bits
    static_worth: float = 1500.0
    opacity_bits: float = 10.0  #: worth of an opacity below which it is stored as 1, bits


@dataclass(frozen=True, slots=True)
class _Slope:
    """How many Gaussians a slope is worth."""

    fall: float = 0.7  #: power by which the squared error falls with the number of Gaussians
    #: that one Gaussian takes, and has to be worth: one that stands still, and motion
    gaussian_bits: float = 48.0
    motion_bits: float = 25.0
    moving_px: float = 0.5  #: of motion to the end of a GOP, above which a Gaussian moves
    growth: float = 0.2  #: power by which their number grows with the steps of the fit
    #: time to fit a Gaussian that stands still, and one that moves / time that `fitted` counts by
    still_time: float = 0.15
    moving_time: float = 1.5
    #: Gaussians that a slope wants / those that there is time for, above which there are more
    scarce: float = 3.0
    steps: float = 600.0  #: of a fit with the number by `fall` and bits alone
    #: what those that came last save in the median / their bits, where the number is by `fall`
    paid_usual: float = 1.4
    paid_power: float = 0.75  #: power by which the number grows with that
    paid_range: tuple[float, float] = (0.25, 1.6)  #: of the factor of the number that it gives
    lasting: float = 0.3  #: power of what a GOP lasts by which its steps are finer


@dataclass(frozen=True, slots=True)
class _Staged:
    """Staged quantisation."""

    effort: float = 0.12  #: effort of tuning / effort of the GOP
    rates: float = 0.05  #: rates at the beginning of a stage / rates of the recipe


@dataclass(frozen=True, slots=True)
class _RateControl:
    """Meeting a size or a quality."""

    tunings: int = 4  #: most trials of the qscale with tuning
    octave: float = 2.4  #: dB gained by half the qscale of the slope
    spare: float = 0.4  #: dB by which a fit is to be above its target, where another was below
    rounding: float = 0.15  #: dB that a fit loses where it is stored as finely as `reach` lets it
    near: float = 0.04  #: dB by which a quality may be missed
    reach: float = 1.6  #: most qscale of a GOP that is to reach a quality / that of its slope
    size_room: float = 0.003  #: bytes kept free for what tuning may add / size
    finest_usual: float = 0.5  #: finest qscale where a size is to be met / usual one
    finest: float = 0.1  #: finest qscale
    coarsest: float = 16.0  #: coarsest qscale


EFFORT = _Effort()
START = _Start()
PLATE = _Plate()
TRIPLANE = _TriPlane()
TRACKS = _Tracks()
OPACITY = _Opacity()
RELOCATION = _Relocation()
EFFECT = _Effect()
PRICE = _Price()
PREDICTION = _Prediction()
MOVING = _Moving()
TILES = _Tiles()
STEPS = _Steps()
SLOPE = _Slope()
STAGED = _Staged()
RATE_CONTROL = _RateControl()
