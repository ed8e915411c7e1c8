"""Which GOPs a file has: key GOPs alone or chains of predicted ones, by what they would cost."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import fmean

from gsvrcodec.encoder.analysis import FrameStats
from gsvrcodec.encoder.rate import bit_weights, expected_bpp, expected_psnr
from gsvrcodec.encoder.settings import EncodeSettings
from gsvrcodec.encoder.slicing import Chain, ChainLimits, GopLimits, pace, slice_gops
from gsvrcodec.encoder.tuned import ANALYSIS, CHAIN, GOP_LENGTH


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
