"""What the statistics of frames say about bits and quality, before anything is fitted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import fmean

from gsvrcodec.encoder.analysis import FrameStats
from gsvrcodec.encoder.settings import EncodeSettings
from gsvrcodec.encoder.slicing import Chain
from gsvrcodec.encoder.tuned import CHAIN, CRF, RATE
from gsvrcodec.fit.precision import bit_worth
from gsvrcodec.fit.tuned import EFFORT, RATE_CONTROL


def wanted_bytes(
    settings: EncodeSettings, size: tuple[int, int], frames: int, seconds: float, streams: int
) -> tuple[str, float]:
    """The argument that says how large the file is to be, and that size without streams, bytes."""
    if settings.bpp is not None:
        return f"`bpp={settings.bpp:g}`", settings.bpp * size[0] * size[1] * frames / 8
    if settings.bitrate is not None:
        return f"`bitrate={settings.bitrate}`", settings.bitrate * seconds / 8
    return f"`target_size={settings.target_size}`", (settings.target_size or 0) - streams


def qscale_of(crf: float) -> float:
    """The qscale of all GOPs for a number on the scale of constant quality."""
    qscale = CRF.qscale * 2 ** ((crf - CRF.at) / CRF.octave)
    return min(max(qscale, RATE_CONTROL.finest), RATE_CONTROL.coarsest)


def frame_visits(settings: EncodeSettings) -> float:
    """How often a fit visits each frame, without a wall time.

    A high quality has more Gaussians, which take longer. Without more visits a flower and a bee
    have 1.6 and 1.7 dB less at CRF 20 and preset medium; the flower is no better than at CRF 24.
    """
    visits = float(EFFORT.frame_visits[settings.preset])
    if settings.quality is None:
        return visits
    return visits * max(1.0, 1 / qscale_of(settings.quality))


def visited_frames(frames: int) -> int:
    """Frames that the visits of a GOP are counted for: at least so many that its fit converges."""
    return max(frames, EFFORT.least_frames)


def expected_bpp(
    stats: Sequence[FrameStats], size: tuple[int, int], settings: EncodeSettings, *, seconds: float
) -> float:
    """Bits a pixel that are asked for, or that what is asked for may take; inf = not known."""
    if not stats:
        return math.inf
    if settings.params is not None and settings.profile == "main":
        return RATE.number_bits * settings.params / (len(stats) * size[0] * size[1])
    if not settings.has_target:
        return math.inf
    if settings.target_psnr is not None:
        return bpp_for(stats, settings.target_psnr)
    if settings.quality is not None:
        return bpp_at(stats, qscale_of(settings.quality))
    _, total = wanted_bytes(settings, size, len(stats), seconds, 0)
    return 8 * total / (len(stats) * size[0] * size[1])


def expected_psnr(
    stats: Sequence[FrameStats], size: tuple[int, int], settings: EncodeSettings, *, seconds: float
) -> float:
    """Quality that is asked for, or that the bits asked for may give, dB."""
    if settings.target_psnr is not None:
        return settings.target_psnr
    bpp = expected_bpp(stats, size, settings, seconds=seconds)
    if not 0 < bpp < math.inf:
        return RATE.usual_psnr
    return 10 * math.log10(255.0**2 * bpp**RATE.fall / (RATE.error * _complexity(stats)))


def bpp_for(stats: Sequence[FrameStats], psnr: float) -> float:
    """Bits a pixel that frames may need for a quality, dB."""
    error = 255.0**2 / 10 ** (psnr / 10)
    return float((RATE.error * _complexity(stats) / error) ** (1 / RATE.fall))


def bpp_at(stats: Sequence[FrameStats], qscale: float) -> float:
    """Bits a pixel at which one more saves as much error as at a qscale."""
    slope = RATE.fall * RATE.error * _complexity(stats) / bit_worth(qscale)
    return float(slope ** (1 / (1 + RATE.fall)))


def bit_weights(chain: Chain, stats: Sequence[FrameStats], psnr: float) -> list[float]:
    """Bits of each GOP of a chain, in those of its key GOP.

    Args:
        chain: frames of each GOP.
        stats: statistics of every frame.
        psnr: quality of the pictures, dB.
    """
    key = _complexity(stats[chain[0].start : chain[0].stop])
    weights = [1.0]
    for gop in chain[1:]:
        own = stats[gop.start : gop.stop]
        changed = fmean(frame.changed_at(psnr) for frame in own)
        changing = CHAIN.idle_bits + CHAIN.changing_bits * changed
        weights.append(changing * (_complexity(own) / key) ** CHAIN.evenness)
    return weights


def _complexity(stats: Sequence[FrameStats]) -> float:
    """Complexity of frames, squared 8-bit codes."""
    return fmean(frame.change + RATE.detail_share * frame.detail + 1.0 for frame in stats)
