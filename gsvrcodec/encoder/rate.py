"""What the statistics of frames say about bits and quality, and which GOPs a file has by that."""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import fmean

from gsvrcodec.encoder.analysis import FrameStats
from gsvrcodec.encoder.film import Chain, ChainLimits, GopLimits, pace, slice_gops
from gsvrcodec.encoder.settings import EncodeSettings
from gsvrcodec.encoder.tuned import ANALYSIS, CHAIN, CRF, GOP_LENGTH, RATE
from gsvrcodec.fit.tuned import EFFORT, RATE_CONTROL
from gsvrcodec.fit.worth import bit_worth


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
    """Bits of each GOP of a chain / bits of its key GOP.

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


def structure(
    stats: Sequence[FrameStats], size: tuple[int, int], settings: EncodeSettings, *, seconds: float
) -> list[Chain]:
    """Frames of each GOP, by chain.

    A Gaussian that lives longer is paid for less often, but follows less of the motion, and many
    Gaussians in a long GOP take a long fit. So GOPs are the longer the fewer bits a frame gets.

    Args:
        stats: statistics of every frame.
        size: width and height, pixels.
        settings: of the encode.
        seconds: duration of the video.
    """
    bpp = expected_bpp(stats, size, settings, seconds=seconds)
    psnr = expected_psnr(stats, size, settings, seconds=seconds)
    alone, chained = limits(bpp, len(stats), settings, seconds=seconds)

    def pays(chain: Chain, apart: float) -> bool:
        """Whether a chain costs clearly less than so many key GOPs.

        Fast motion asks for short GOPs, and they follow it better than long ones.
        """
        if len(chain) == 1:
            return True  # It is a key GOP.
        assert chained is not None
        frames = stats[chain[0].start : chain[-1].stop]
        fast = fmean(pace(frame, chained.gops) for frame in frames) > CHAIN.fast
        return fast or sum(bit_weights(chain, stats, psnr)) < CHAIN.worth * apart

    return slice_gops(stats, settings.gop, alone, chained, pays)


def limits(
    bpp: float, frames: int, settings: EncodeSettings, *, seconds: float
) -> tuple[GopLimits, ChainLimits | None]:
    """When GOPs and chains end.

    Args:
        bpp: bits a pixel; inf = not known.
        frames: of the video.
        settings: of the encode.
        seconds: duration of the video.

    Returns:
        Limits of key GOPs from which none is predicted, and of chains; None = every GOP is a key
        GOP.
    """

    def gops(longest: int, motion: float, fast_share: float = 0.0) -> GopLimits:
        longest = settings.gop_max or max(longest, settings.gop_min)
        return GopLimits(settings.gop_min, longest, motion, fast_share)

    by_rate = min(round(GOP_LENGTH.frames_bpp / bpp), GOP_LENGTH.longest)
    alone = gops(max(GOP_LENGTH.shortest, by_rate), ANALYSIS.threshold)
    if not settings.predicts or not frames:
        return alone, None
    longer = min(max(1.0, CHAIN.longer_bpp / bpp), CHAIN.longer)
    longest = round(longer**CHAIN.longest_power * CHAIN.longest)
    chained = gops(longest, longer * CHAIN.threshold, CHAIN.fast_share)
    return alone, ChainLimits(max(1, round(settings.keyint * frames / seconds)), chained)
