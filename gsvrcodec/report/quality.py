"""How close coded frames come to their source, frame by frame and in all."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from statistics import fmean

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.metrics import psnr_of, similarity, squared_error


@dataclass(frozen=True, slots=True)
class PictureQuality:
    """One picture against its source."""

    squared_error: float  #: mean over the 8-bit RGB samples
    psnr_rgb: float  #: over the same, dB
    ssim: float | None  #: of luma; None = the picture is too small
    ms_ssim: float | None  #: of luma; None = the picture is too small

    @classmethod
    def of(cls, source: NDArray[np.uint8], coded: NDArray[np.uint8]) -> PictureQuality:
        """Compare two (H, W, 3) uint8 RGB pictures."""
        error = squared_error(source, coded)
        likeness = similarity(source, coded)
        return cls(error, psnr_of(error), likeness.ssim, likeness.ms_ssim)


@dataclass(frozen=True, slots=True, kw_only=True)
class Quality:
    """All frames against their source."""

    psnr_rgb: float  #: mean of the frames' PSNR, dB
    psnr_rgb_pooled: float  #: PSNR of the mean squared error of all frames, dB
    psnr_rgb_min: float  #: of the worst frame, dB
    ssim: float | None  #: mean of the frames; None = they are too small
    ms_ssim: float | None  #: mean of the frames; None = they are too small

    @classmethod
    def of(cls, frames: Iterable[PictureQuality]) -> Quality:
        """Sum up frames, at least one."""
        frames = list(frames)
        return cls(
            psnr_rgb=fmean(frame.psnr_rgb for frame in frames),
            psnr_rgb_pooled=psnr_of(fmean(frame.squared_error for frame in frames)),
            psnr_rgb_min=min(frame.psnr_rgb for frame in frames),
            ssim=_mean(frame.ssim for frame in frames),
            ms_ssim=_mean(frame.ms_ssim for frame in frames),
        )


def _mean(values: Iterable[float | None]) -> float | None:
    """Return the mean; None = one is not known."""
    known = list(values)
    numbers = [value for value in known if value is not None]
    return fmean(numbers) if len(numbers) == len(known) else None
