"""Quality of decoded pictures against their source, by frame and over all frames."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from statistics import fmean

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.metrics import ms_ssim_db, psnr_of, similarity, squared_error


@dataclass(frozen=True, slots=True)
class PictureQuality:
    """Quality of one picture."""

    squared_error: float  #: mean over the 8-bit RGB samples
    psnr_rgb: float  #: PSNR over the 8-bit RGB samples, dB
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
    """Quality of all frames."""

    psnr_rgb: float  #: mean of the frames' PSNR, dB
    psnr_rgb_pooled: float  #: PSNR of the mean squared error of all frames, dB
    psnr_rgb_min: float  #: PSNR of the worst frame, dB
    ssim: float | None  #: mean of the frames; None = the frames are too small
    ms_ssim: float | None  #: mean of the frames; None = the frames are too small

    @property
    def ms_ssim_db(self) -> float | None:
        """Mean MS-SSIM as -10 log10(1 - ms_ssim), dB; None = the frames are too small."""
        return None if self.ms_ssim is None else ms_ssim_db(self.ms_ssim)

    @classmethod
    def of(cls, frames: Iterable[PictureQuality]) -> Quality:
        """Return the quality over `frames`, at least one."""
        frames = list(frames)
        return cls(
            psnr_rgb=fmean(frame.psnr_rgb for frame in frames),
            psnr_rgb_pooled=psnr_of(fmean(frame.squared_error for frame in frames)),
            psnr_rgb_min=min(frame.psnr_rgb for frame in frames),
            ssim=_mean(frame.ssim for frame in frames),
            ms_ssim=_mean(frame.ms_ssim for frame in frames),
        )


def _mean(values: Iterable[float | None]) -> float | None:
    """Return the mean of the values; None = a value is None."""
    known = list(values)
    numbers = [value for value in known if value is not None]
    return fmean(numbers) if len(numbers) == len(known) else None
