"""What the statistics of frames say about bits and quality."""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import fmean
from typing import TYPE_CHECKING

from gsvrcodec.encoder.tuned import CHAIN, CRF, RATE
from gsvrcodec.fit.target import bit_worth
from gsvrcodec.fit.tuned import EFFORT, PREDICTION, RATE_CONTROL

if TYPE_CHECKING:
    from gsvrcodec.encoder.analysis import FrameStats


def qscale_of(crf: float) -> float:
    """The qscale of all GOPs for a number on the scale of constant quality."""
    qscale = CRF.qscale * 2 ** ((crf - CRF.at) / CRF.octave)
    return min(max(qscale, RATE_CONTROL.finest), RATE_CONTROL.coarsest)


def crf_of(qscale: float) -> float:
    """The number on the scale of constant quality for a qscale, within the scale."""
    return min(max(0.0, CRF.at + CRF.octave * math.log2(qscale / CRF.qscale)), CRF.highest)


def visited_frames(frames: int) -> int:
    """Frames that the visits of a GOP are counted for: at least so many that its fit converges."""
    return max(frames, EFFORT.least_frames) if frames > 1 else EFFORT.still_frames


def bpp_for(stats: Sequence[FrameStats], psnr: float) -> float:
    """Bits a pixel that frames may need for a quality, dB."""
    error = 255.0**2 / 10 ** (psnr / 10)
    return float((RATE.error * complexity(stats) / error) ** (1 / RATE.fall))


def bpp_at(stats: Sequence[FrameStats], qscale: float) -> float:
    """Bits a pixel at which one more saves as much error as at a qscale."""
    slope = RATE.fall * RATE.error * complexity(stats) / bit_worth(qscale)
    return float(slope ** (1 / (1 + RATE.fall)))


def qscale_at(stats: Sequence[FrameStats], bpp: float) -> float:
    """The qscale at which `bpp_at` comes to these bits a pixel."""
    slope = RATE.fall * RATE.error * complexity(stats) / bpp ** (1 + RATE.fall)
    return math.sqrt(slope / bit_worth(1.0))


def bit_weights(chain: Sequence[range], stats: Sequence[FrameStats], psnr: float) -> list[float]:
    """Bits of each GOP of a chain / bits of its key GOP.

    Args:
        chain: frames of each GOP.
        stats: statistics of every frame.
        psnr: quality of the pictures, dB.
    """
    key = complexity(stats[chain[0].start : chain[0].stop])
    weights = [1.0]
    for gop in chain[1:]:
        own = stats[gop.start : gop.stop]
        changed = fmean(frame.changed_at(psnr) for frame in own)
        changing = CHAIN.idle_bits + CHAIN.changing_bits * changed
        weights.append(changing * (complexity(own) / key) ** CHAIN.evenness)
    return weights


def lasting(chain: Sequence[range], stats: Sequence[FrameStats], psnr: float) -> float:
    """Frames that a Gaussian of the key GOP of a chain lasts, in the mean / frames of that GOP.

    It lasts until the picture changes where it lies: as a rule the same places change in all GOPs.
    Where most of the picture has changed, the next key GOP begins.

    Args:
        chain: frames of each GOP.
        stats: statistics of every frame.
        psnr: quality of the pictures, dB.
    """
    left, frames = 1.0, float(len(chain[0]))
    for gop in chain[1:]:
        changed = fmean(frame.changed_at(psnr) for frame in stats[gop.start : gop.stop])
        left = min(left, 1 - changed)
        if left < PREDICTION.kept:
            break
        frames += left * len(gop)
    return frames / len(chain[0])


def complexity(stats: Sequence[FrameStats]) -> float:
    """Complexity of frames, squared 8-bit codes."""
    return fmean(frame.change + RATE.detail_share * frame.detail + 1.0 for frame in stats)
