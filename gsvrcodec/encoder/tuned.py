"""Constants of the encoder around a fit that were found by trying, by topic.

docs/tuning.md has what was tried for each, on which clips, and what it gave.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class _Analysis:
    """Frame statistics."""

    height: int = 180  #: rows that frames are analysed at, so that motion is free of resolution
    #: a frame changes where it differs from the picture `lag` frames before
    lag: int = 8  #: frames
    noise: float = 2.0  #: difference that does not count / difference that motion does not explain
    changed_px: int = 9  #: box size of the squared difference, px of the analysed frame
    visible: float = 2.0  #: squared difference / error of the quality from which it counts in full
    qualities: tuple[float, ...] = (28.0, 32.0, 36.0, 40.0, 44.0)  #: that it is told for, dB
    rest: float = 0.1  #: motion of the fastest of a frame that is as the one before, at most, px
    #: a cut changes the picture at once, by all three
    cut_correlation: float = 0.75  #: correlation of the histograms of two frames, below
    cut_difference: float = 18.0  #: mean difference of two frames, above; 8-bit codes
    cut_ratio: float = 4.0  #: mean difference / usual mean difference, above
    #: frames of which most have to rest where a change at once is one by the last two alone
    resting: int = 4


@dataclass(frozen=True, slots=True)
class _Paths:
    """Quadratic paths of points, and what pictures along them leave of the frames of a GOP."""

    spacing: int = 8  #: of the points, px of the analysed frame
    grid: int = 2  #: frames from one first frame to the next; the lengths are multiples of it
    #: frames of GOPs that it is told for
    lengths: tuple[int, ...] = (4, 6, 8, 10, 12, 16, 20, 24, 32, 40, 48, 64, 80, 96, 128)
    #: frames after the first one that are looked at
    looks: tuple[int, ...] = (1, 2, 3, 5, 7, 9, 11, 15, 19, 23, 31, 39, 47, 63, 79, 95, 127)


@dataclass(frozen=True, slots=True)
class _Lookahead:
    """How much of a shot is planned together."""

    seconds: float = 32.0  #: length of a section; the fit of a longer shot begins after two of them


@dataclass(frozen=True, slots=True)
class _GopLength:
    """Adaptive GOPs."""

    shortest: int = 32  #: frames of the longest at a high rate
    longest: int = 128  #: the same at a low rate
    frames_bpp: float = 1.0  #: the same x bpp, between the two
    #: squared error that the bits of a GOP save elsewhere at qscale 1 / root of its frames over
    #: their change, and the next power of their detail
    price: float = 0.25
    detail_power: float = 1.5
    qscale_power: float = 0.5  #: by which it grows with the qscale
    effort_power: float = 0.4  #: the same with visits: motion of long GOPs takes more of them
    height: int = 720  #: rows of films for which it holds; where there are more, it is the less
    changed_power: float = 2.0  #: by which it falls with the part that changes, where most lasts
    motion: float = 24.0  #: accumulated motion at which a published GOP ends, px


@dataclass(frozen=True, slots=True)
class _Rate:
    """How bits, Gaussians and quality go together; clips differ by some dB."""

    gaussian_bits: float = 64.0  #: payload / Gaussians at the best trade against their steps, bits
    #: mean squared error = error * complexity / bpp^fall,
    #: complexity = change + detail_share * detail
    error: float = 0.05
    fall: float = 0.77
    detail_share: float = 0.06
    taken: float = 0.42  #: bits that a constant quality takes / bits by this, in the mean
    number_bits: float = 5.0  #: file / stored numbers, bits
    usual_psnr: float = 36.0  #: dB, where nothing tells the size
    least_gop_bytes: int = 1500  #: payload of a GOP that is hardly more than its tables


@dataclass(frozen=True, slots=True)
class _Crf:
    """The scale of constant quality."""

    at: float = 26.0  #: number of a file
    qscale: float = 1.0  #: that has this qscale
    octave: float = 4.75  #: numbers between a qscale and its double
    highest: float = 51.0  #: number, as of x264


@dataclass(frozen=True, slots=True)
class _Chain:
    """Key GOPs and the GOPs predicted from them."""

    fast: float = 0.8  #: motion of a frame above which a chain always pays, px
    worth: float = 0.9  #: cap on bits of a chain of slower motion / bits of key GOPs in its place
    fast_share: float = 0.3  #: motion added to a frame / motion of its fastest 1 %
    #: bits of a predicted GOP / bits of its key GOP at equal N
    idle_bits: float = 0.05  #: where nothing changes
    changing_bits: float = 0.72  #: added where all changes
    evenness: float = 0.325  #: power of complexity / that of the key GOP by which these bits grow
    gaussian_bits: float = 57.0  #: payload of a key GOP / Gaussians, bits
    fitted_a_second: float = 1000.0  #: changing Gaussians that a core can fit in a second
    idle_step: float = 0.4  #: time of a step without change / time of a step of the key GOP


@dataclass(frozen=True, slots=True)
class _Size:
    """Meeting a size of a file."""

    time: float = 0.2  #: time of a first pass / time budget
    passes: int = 2  #: most first passes
    passes_plates: int = 3  #: the same where there are plates, whose bytes come in coarse steps
    near: float = 2.5  #: CRF by which the last of them may differ from what it finds
    near_plates: float = 1.0  #: the same where there are plates
    effort: float = 0.92  #: bytes of GOPs without plates / those of a first pass of less effort
    head_bytes: int = 250  #: of the payload of a GOP that do not depend on the qscale
    plate_power: float = 0.65  #: bytes of plates fall by the qscale to the power of minus this
    power: float = 1.15  #: bytes of all else do
    trust: float = 0.2  #: weight of the plan of a chain / weight of what its GOPs take
    fuller: float = 0.92  #: qscale that the last GOP of a chain is fitted for / that by its bytes
    least_gop_bytes: int = 300  #: payload of the smallest GOP
    reach: float = 2.5  #: most qscale of a GOP / that of the film, and inversely


@dataclass(frozen=True, slots=True)
class _Psnr:
    """Meeting a mean PSNR."""

    time: float = 0.4  #: time of a first pass / time budget
    guess: float = 2.0  #: dB by which the model of bits is too pessimistic, in the mean
    crf_step: float = 0.5  #: dB that a CRF costs
    effort: float = 0.9  #: dB that a film has more than a first pass of less effort


@dataclass(frozen=True, slots=True)
class _Processes:
    """When several processes pay."""

    step_seconds: float = 15e-9  #: time of an optimiser step for each pixel of its frame
    least_seconds: float = 2.0  #: a shorter encode is done by one process before others start
    process_bytes: int = 100 * 2**20  #: memory of a process
    fit_bytes: int = 9  #: memory of a fit, and of what waits for it, / bytes of its frames


ANALYSIS = _Analysis()
PATHS = _Paths()
LOOKAHEAD = _Lookahead()
GOP_LENGTH = _GopLength()
RATE = _Rate()
CRF = _Crf()
CHAIN = _Chain()
SIZE = _Size()
PSNR = _Psnr()
PROCESSES = _Processes()
