"""Constants of the encoder around a fit that were found by trying, by topic.

Each topic says what it was measured on. "Six clips" are Bunny and those of
`tests/benchmarks/clips.py`; "Bunny" is the benchmark clip alone, so that other video may want
another value.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class _Analysis:
    """Frame statistics. Ten clips at 0.1 bpp, GOPs of 4 to 36 frames; clips-gop.json."""

    height: int = 180  #: rows that frames are analysed at, so that motion is free of resolution
    #: what changes from GOP to GOP: squared difference to the picture so many frames before, beyond
    #: so many times that which motion does not explain, mean of a box (px of the analysed frame).
    #: It counts in full where it is over so many times the error of the quality. The mean over a
    #: predicted GOP correlates by 0.96 with the fraction of Gaussians that are not kept: five clips
    #: at four rates, also with 0 to 2 times the unexplained; 2 is best for a clip of noise.
    lag: int = 8
    noise: float = 2.0
    changed_px: int = 9
    visible: float = 2.0
    qualities: tuple[float, ...] = (28.0, 32.0, 36.0, 40.0, 44.0)  #: dB, that it is told for
    threshold: float = 24.0  #: accumulated motion at which a GOP ends, px of the analysed frame
    #: A cut changes the picture at once: the histograms of the frames correlate less than this,
    cut_correlation: float = 0.75
    cut_difference: float = 18.0  #: the mean difference is more than this, 8-bit codes,
    cut_ratio: float = 4.0  #: and more than so many times the usual one


@dataclass(frozen=True, slots=True)
class _Lookahead:
    """How much of a shot is planned together."""

    #: seconds; the fit of a longer shot begins after twice as many, and eight chains of the default
    #: length keep a machine busy during the analysis of the next
    seconds: float = 32.0


@dataclass(frozen=True, slots=True)
class _GopLength:
    """Longest adaptive GOP. Bunny at 0.015 to 0.11 bpp; bunny-rate-2s.json."""

    shortest: int = 32  #: frames, at a high rate
    longest: int = 128  #: frames, at a low rate
    frames_bpp: float = 3.2  #: frames of the longest GOP times bpp, between the two


@dataclass(frozen=True, slots=True)
class _Rate:
    """How bits, Gaussians and quality go together. Bunny; other clips differ by some dB."""

    #: bits of the payload for each Gaussian, all planes counted, at the best trade of their number
    #: against their steps. First 16 frames, 25 visits, 58 / 64 / 70 bits: Bunny 34.3 / 34.4 /
    #: 34.3 dB at 0.06 bpp, bee 33.1 / 33.3 / 32.8 at 0.12, flower 36.6 / 37.3 / 37.0 at 0.06.
    gaussian_bits: float = 64.0
    #: mean squared error = error * complexity / bpp**fall, where the complexity of frames is their
    #: change + detail_share * detail
    error: float = 0.05
    fall: float = 0.77
    detail_share: float = 0.06
    most_unequal: float = 8.0  #: largest ratio of a GOP's bytes a frame to the mean, and inversely
    number_bits: float = 5.0  #: of the file for each stored number
    usual_psnr: float = 36.0  #: dB, where nothing tells the size
    least_gop_bytes: int = 1500  #: payload of a GOP that is hardly more than its tables


@dataclass(frozen=True, slots=True)
class _Crf:
    """The scale of constant quality."""

    at: float = 26.0  #: number of a file
    qscale: float = 1.0  #: that has this qscale
    octave: float = 4.75  #: numbers between a qscale and its double


@dataclass(frozen=True, slots=True)
class _TriPlane:
    """Size of the tri-plane. Bunny, cup, portrait and flower at 0.015 to 0.02 bpp."""

    cell_px: float = 20.0  #: side of a cell, px of the coded frame
    cells: tuple[int, int] = (4, 64)  #: fewest and most cells of a side
    #: numbers of a tri-plane, in those of the Gaussians that are expected; a finer one has fewer
    #: cells a side. Of means, 48 frames at CRF 26, any / 0.1 / 0.05 / 0.025: cup 44.10 dB in 45.5
    #: kB / 44.01 in 40.1 / 43.98 in 36.2 / 43.73 in 33.8, and at CRF 32 42.13 dB in 25.1 kB / - /
    #: 41.96 in 16.0; coffee 39.44 dB in 305 kB / - / 39.40 in 299 / 39.26 in 288. Handheld shots
    #: need the motion of each frame, but few cells: flower 33.1 dB without, 39.0 with 12x6 or 64x36
    share: float = 0.04


@dataclass(frozen=True, slots=True)
class _Chain:
    """Key GOPs and the GOPs predicted from them."""

    #: frames of the longest predicted GOP, and motion at which it ends, px of the analysed frame
    longest: int = 24
    threshold: float = 16.0
    #: bpp below which both are larger, most factor of the motion, and its power that the frames are
    #: larger by. At 0.045 / bpp, power 1 and 2.4: cup at 0.015 bpp +2.8 and +3.5 dB, Bunny at 0.025
    #: bpp +1.3 and +1.6 dB, flower at 0.026 bpp +1.1 and +1.6 dB, bee at 0.031 bpp -0.2 dB. Twice
    #: the motion at 0.06 bpp: Bunny -0.2 dB; GOPs of 64 frames at 0.044 bpp: cup -0.35 dB
    longer_bpp: float = 0.045
    longer: float = 2.0
    longest_power: float = 2.4
    #: motion of a frame, with `fast_share`, above which a chain always pays, px of the analysed
    #: frame. Of sums, `fast_share` 0.15, 1 s a frame: flower (0.2 px) -0.3 dB at 0.03 and 0.08 bpp,
    #: +0.1 at 0.2; Bunny (0.4) -0.5 dB at 0.06 bpp; city (0.2) -2.0 dB at 0.15 bpp; cup (0.9) +0.4,
    #: +0.1 and +0.3 dB at 0.024, 0.044 and 0.075 bpp; bee (1.5) 0, -0.2 and +1.0 dB at 0.06, 0.12
    #: and 0.17 bpp; driving (4) +0.3 dB at 0.12 bpp; soccer (0.7) +1.6 dB at 0.08 bpp
    fast: float = 0.8
    #: most that a chain of slower motion may cost, in the key GOPs that could take its place. Two
    #: GOPs of 48 frames of flower at 0.026 bpp have 0.98, and lose 1.2 dB by a chain; Bunny's first
    #: half at 0.025 bpp has 0.97, and loses 0.3 dB
    worth: float = 0.9
    #: what the fastest 1 % of a frame adds to its motion, where the rest stands still. soccer, 72
    #: frames at 0.08 bpp in GOPs of 18 / 11 / 7: 31.1 / 30.3 / 29.5 dB, but where it moves 27.2 /
    #: 28.9 / 29.4 dB. Bunny loses 0.6 dB if its GOPs become as short, because it moves all over. Of
    #: means, 48 frames at CRF 26, 0.15 / 0.3: soccer 633 kB at 32.5 dB / 616 kB at 33.1 dB
    fast_share: float = 0.3
    #: bits of a predicted GOP, in those of a key GOP of as many Gaussians: where nothing changes,
    #: and what is added where all does
    idle_bits: float = 0.05
    changing_bits: float = 0.72
    #: power of the complexity of the frames, in that of the key GOP, by which these bits grow. 72
    #: frames of cup at 0.03 bpp, where a hand comes in: 0 39.0 dB, 0.325 40.2 dB, 0.65 40.0 dB;
    #: Bunny at 0.06 bpp loses 0.1 and 0.3 dB
    evenness: float = 0.325
    #: bits of the payload of a key GOP for each Gaussian. 40 frames, 52 / 57 / 62 bits: bee 33.8 /
    #: 33.9 / 33.8 dB at 0.12 bpp, soccer 30.7 / 30.4 / 30.2 dB at 0.100 / 0.097 / 0.096 bpp
    gaussian_bits: float = 57.0
    #: bits of the payload of a small GOP for each number of its tri-plane. cup at 0.015 bpp
    number_bits: float = 5.0
    #: Gaussians that a core can fit in a second of the wall time of a predicted GOP that changes
    #: all over. 2 cores, 1 s a frame of 720p (2 s of 1080p), 24 frames: bee, GOPs of 8, 34 000
    #: Gaussians 34.1 dB at 0.24 bpp, 22 000 35.1 dB at 0.20; driving, GOPs of 6, 58 000 31.3 dB at
    #: 0.24, 38 000 32.9 dB at 0.21; flower, GOPs of 12, 32 000 39.8 dB at 0.16, 21 000 39.3 dB at
    #: 0.15
    fitted_a_second: float = 1000.0
    #: effort for a frame of the first GOP, in that of other frames, because all of the chain gains
    key_effort: float = 2.0
    #: time of an optimiser step where nothing changes, in that of the key GOP; where all does it
    #: takes as long. With 1 a key GOP of few frames gets too little of a wall time. 48 frames at
    #: CRF 26 and 0.5 s a frame, 0.15 / 0.3 / 0.45 gain over 1 at equal size: soccer 1.4 / 1.9 /
    #: 1.7 dB (0.6: 1.2), cup -0.1 / 0.4 / 0.6, flower 0.1 / 0.1 / 0.1, Bunny -0.2 / 0 / -0.1, bee
    #: -0.4 / -0.2 / -0.4
    idle_step: float = 0.4


@dataclass(frozen=True, slots=True)
class _Processes:
    """When several processes pay. 2 cores of an AMD EPYC."""

    step_seconds: float = 15e-9  #: time of an optimiser step for each pixel of its frame
    least_seconds: float = 10.0  #: a shorter encode is done by one process before others start
    process_bytes: int = 300 * 2**20  #: memory of a process; 240 MB measured
    fit_bytes: int = 7  #: memory of a fit for each byte of its frames; 6 measured


ANALYSIS = _Analysis()
LOOKAHEAD = _Lookahead()
GOP_LENGTH = _GopLength()
RATE = _Rate()
CRF = _Crf()
TRIPLANE = _TriPlane()
CHAIN = _Chain()
PROCESSES = _Processes()
