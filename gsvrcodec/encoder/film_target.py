"""Targets of a film: numbers, a constant quality, a mean PSNR, a size.

A target knows which bits and which quality to expect of frames, how many bits each chain gets, and
what each GOP of it is to reach.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from gsvrcodec.encoder.rate import bpp_at, bpp_for, complexity, qscale_of
from gsvrcodec.encoder.tuned import RATE
from gsvrcodec.errors import UsageError
from gsvrcodec.fit.target import Count, Quality, Size, Slope, Target

if TYPE_CHECKING:
    from gsvrcodec.encoder.analysis import FrameStats


class FilmTarget(ABC):
    """What a file is to take or to reach."""

    __slots__ = ()

    @property
    def shares_out(self) -> bool:
        """Whether bits or numbers are shared out over the whole film."""
        return False

    @abstractmethod
    def bpp(self, stats: Sequence[FrameStats], size: tuple[int, int], seconds: float) -> float:
        """Return the bits a pixel that are asked for, or that frames may need; inf = not known.

        Args:
            stats: Statistics of the frames.
            size: Width and height, pixels.
            seconds: Duration of the frames.
        """

    def psnr(self, stats: Sequence[FrameStats], size: tuple[int, int], seconds: float) -> float:
        """Return the quality that is asked for, or that the bits may give, dB; see `bpp`."""
        bpp = self.bpp(stats, size, seconds)
        if not 0 < bpp < math.inf:
            return RATE.usual_psnr
        return 10 * math.log10(255.0**2 * bpp**RATE.fall / (RATE.error * complexity(stats)))

    def chain_bits(
        self,
        stats_of: Sequence[Sequence[FrameStats]],
        gops: Sequence[int],
        size: tuple[int, int],
        *,
        seconds: float,
        overhead: int,
        streams: int,
    ) -> list[float]:
        """Return the bits of each chain of a section.

        Args:
            stats_of: Statistics of the frames of each chain.
            gops: Number of GOPs of each chain.
            size: Width and height, pixels.
            seconds: Duration of the section.
            overhead: Bytes of the file that are neither payloads of GOPs nor copied streams.
            streams: Bytes of the copied streams.

        Raises:
            UsageError: The size asked for is too little.
        """
        area = size[0] * size[1]
        return [len(own) * area * self.bpp(own, size, seconds) for own in stats_of]

    @abstractmethod
    def of_gop(self, bits: float, most: int, lasting: float) -> Target:
        """Return the target of a GOP.

        Args:
            bits: Bits that it gets.
            most: Most Gaussians of it.
            lasting: Frames that its Gaussians last / frames of the GOP.
        """


@dataclass(frozen=True, slots=True)
class Numbers(FilmTarget):
    """Stored numbers or Gaussians, whatever bits they take."""

    params: int | None = None  #: numbers of the whole file; None = not known
    gaussians: int | None = None  #: in each GOP; None = by the length of the GOP

    @property
    def shares_out(self) -> bool:
        """Whether numbers are shared out over the whole film."""
        return self.gaussians is None

    def bpp(self, stats: Sequence[FrameStats], size: tuple[int, int], seconds: float) -> float:
        """Return the bits a pixel that the numbers may take; inf = not known."""
        if self.params is None:
            return math.inf
        return RATE.number_bits * self.params / (len(stats) * size[0] * size[1])

    def of_gop(self, bits: float, most: int, lasting: float) -> Target:
        """Return a number of Gaussians, which the plan knows."""
        return Count()


@dataclass(frozen=True, slots=True)
class ConstantQuality(FilmTarget):
    """The same quality for the eye, by the qscale of all GOPs."""

    crf: float  #: 0 to 51

    @property
    def qscale(self) -> float:
        """The qscale of all GOPs."""
        return qscale_of(self.crf)

    def bpp(self, stats: Sequence[FrameStats], size: tuple[int, int], seconds: float) -> float:
        """Return the bits a pixel at which one more saves as much error as at the qscale."""
        return bpp_at(stats, self.qscale)

    def of_gop(self, bits: float, most: int, lasting: float) -> Target:
        """Return the slope of the qscale."""
        return Slope(self.qscale, most, max(1.0, lasting))


@dataclass(frozen=True, slots=True)
class MeanPsnr(FilmTarget):
    """A mean PSNR of all frames."""

    decibels: float

    def bpp(self, stats: Sequence[FrameStats], size: tuple[int, int], seconds: float) -> float:
        """Return the bits a pixel that frames may need for the quality."""
        return bpp_for(stats, self.decibels)

    def psnr(self, stats: Sequence[FrameStats], size: tuple[int, int], seconds: float) -> float:
        """Return the quality, dB."""
        return self.decibels

    def of_gop(self, bits: float, most: int, lasting: float) -> Target:
        """Return the quality."""
        return Quality(self.decibels)


@dataclass(frozen=True, slots=True)
class FilmSize(FilmTarget):
    """A size of the whole file, as one of three arguments of `encode` says it."""

    argument: Literal["bpp", "bitrate", "target_size"]
    value: float  #: bits a pixel and frame, bits a second, or bytes

    @property
    def shares_out(self) -> bool:
        """Whether bits are shared out over the whole film."""
        return True

    def bytes(self, size: tuple[int, int], frames: int, seconds: float, streams: int) -> float:
        """Return the size of the file without its copied streams, bytes."""
        if self.argument == "bpp":
            return self.value * size[0] * size[1] * frames / 8
        return self.value * seconds / 8 if self.argument == "bitrate" else self.value - streams

    def bpp(self, stats: Sequence[FrameStats], size: tuple[int, int], seconds: float) -> float:
        """Return the bits a pixel that are asked for."""
        total = self.bytes(size, len(stats), seconds, 0)
        return 8 * total / (len(stats) * size[0] * size[1])

    def chain_bits(
        self,
        stats_of: Sequence[Sequence[FrameStats]],
        gops: Sequence[int],
        size: tuple[int, int],
        *,
        seconds: float,
        overhead: int,
        streams: int,
    ) -> list[float]:
        """Return bits that are worth the same in all chains; see `FilmTarget.chain_bits`."""
        lengths = np.array([len(own) for own in stats_of])
        total = self.bytes(size, int(lengths.sum()), seconds, streams) - overhead
        spare = total - RATE.least_gop_bytes * sum(gops)
        if spare < 0:
            gop = "GOP" if sum(gops) == 1 else "GOPs"
            raise UsageError(
                f"`{self.argument}={self.value}` leaves {max(0, round(total))} bytes for "
                f"{sum(gops)} {gop} of at least {RATE.least_gop_bytes}; raise it, use longer GOPs "
                "or a smaller picture"
            )
        needs = np.array([bpp_at(own, 1.0) for own in stats_of])
        mean = float((needs * lengths).sum()) / int(lengths.sum())
        shares = lengths * np.clip(needs, mean / RATE.most_unequal, mean * RATE.most_unequal)
        shares *= spare / shares.sum()
        return [
            8.0 * (RATE.least_gop_bytes * n + int(share))
            for n, share in zip(gops, shares, strict=True)
        ]

    def of_gop(self, bits: float, most: int, lasting: float) -> Target:
        """Return the size of the payload."""
        return Size(int(bits / 8))
