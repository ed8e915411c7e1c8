"""Targets of a film: numbers, a constant quality; aims that such a quality meets: a size, a PSNR.

A target knows which bits and which quality to expect of frames, and what each GOP is to reach. The
constant quality that meets an aim is a guess at first.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal

from gsvrcodec.encoder.rate import bpp_at, bpp_for, complexity, crf_of, qscale_at, qscale_of
from gsvrcodec.encoder.tuned import PSNR, RATE, SIZE
from gsvrcodec.errors import UsageError
from gsvrcodec.fit.target import Count, Slope, Target

if TYPE_CHECKING:
    from gsvrcodec.encoder.analysis import FrameStats


class FilmTarget(ABC):
    """What a file is to take or to reach."""

    __slots__ = ()

    taken: ClassVar[float] = 1.0  #: bits that GOPs take / bits that `bpp` returns, in the mean

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

    @abstractmethod
    def of_gop(self, most: int, lasting: float) -> Target:
        """Return the target of a GOP.

        Args:
            most: Most Gaussians of it.
            lasting: Frames that its Gaussians last / frames of the GOP.
        """


@dataclass(frozen=True, slots=True)
class Numbers(FilmTarget):
    """Stored numbers or Gaussians, whatever bits they take."""

    params: int | None = None  #: numbers of the whole file; None = not known
    gaussians: int | None = None  #: in each GOP; None = by the length of the GOP

    def bpp(self, stats: Sequence[FrameStats], size: tuple[int, int], seconds: float) -> float:
        """Return the bits a pixel that the numbers may take; inf = not known."""
        if self.params is None:
            return math.inf
        return RATE.number_bits * self.params / (len(stats) * size[0] * size[1])

    def of_gop(self, most: int, lasting: float) -> Target:
        """Return a number of Gaussians, which the plan knows."""
        return Count()


@dataclass(frozen=True, slots=True)
class ConstantQuality(FilmTarget):
    """The same quality for the eye, by the qscale of all GOPs."""

    taken = RATE.taken

    crf: float  #: 0 to 51

    @property
    def qscale(self) -> float:
        """The qscale of all GOPs."""
        return qscale_of(self.crf)

    def bpp(self, stats: Sequence[FrameStats], size: tuple[int, int], seconds: float) -> float:
        """Return the bits a pixel at which one more saves as much error as at the qscale."""
        return bpp_at(stats, self.qscale)

    def of_gop(self, most: int, lasting: float) -> Target:
        """Return the slope of the qscale."""
        return Slope(self.qscale, most, max(1.0, lasting))


class Aim(ABC):
    """What a constant quality has to meet, which first passes find."""

    __slots__ = ()

    @abstractmethod
    def guess(
        self, stats: Sequence[FrameStats], size: tuple[int, int], seconds: float
    ) -> ConstantQuality:
        """Return the constant quality that may meet it.

        Args:
            stats: Statistics of the frames.
            size: Width and height, pixels.
            seconds: Duration of the frames.
        """


@dataclass(frozen=True, slots=True)
class MeanPsnr(Aim):
    """A mean PSNR of all frames."""

    decibels: float

    def guess(
        self, stats: Sequence[FrameStats], size: tuple[int, int], seconds: float
    ) -> ConstantQuality:
        """Return the constant quality that may come to it; arguments as of `Aim`."""
        return ConstantQuality(crf_of(qscale_at(stats, bpp_for(stats, self.decibels - PSNR.guess))))


@dataclass(frozen=True, slots=True)
class FilmSize(Aim):
    """A size of the whole file, as one of three arguments of `encode` says it."""

    argument: Literal["bpp", "bitrate", "target_size"]
    value: float  #: bits a pixel and frame, bits a second, or bytes

    def bytes(self, size: tuple[int, int], frames: int, seconds: float, streams: int) -> float:
        """Return the size of the file without its copied streams, bytes."""
        if self.argument == "bpp":
            return self.value * size[0] * size[1] * frames / 8
        return self.value * seconds / 8 if self.argument == "bitrate" else self.value - streams

    def guess(
        self, stats: Sequence[FrameStats], size: tuple[int, int], seconds: float
    ) -> ConstantQuality:
        """Return the constant quality that may come to the size; arguments as of `Aim`."""
        total = 8 * max(1.0, self.bytes(size, len(stats), seconds, 0))
        bpp = total / (len(stats) * size[0] * size[1])
        return ConstantQuality(crf_of(qscale_at(stats, bpp / ConstantQuality.taken)))

    def room(
        self,
        size: tuple[int, int],
        frames: int,
        gops: int,
        *,
        seconds: float,
        overhead: int,
        streams: int,
    ) -> int:
        """Return the bytes that are left for the payloads of GOPs.

        Args:
            size: Width and height, pixels.
            frames: Of the film.
            gops: Of the film.
            seconds: Duration of the film.
            overhead: Bytes of the file that are neither payloads of GOPs nor copied streams.
            streams: Bytes of the copied streams; part of `target_size` alone.

        Raises:
            UsageError: The size asked for is too little.
        """
        room = int(self.bytes(size, frames, seconds, streams)) - overhead
        if room < SIZE.least_gop_bytes * gops:
            raise UsageError(
                f"`{self.argument}={self.value}` leaves {max(0, room)} bytes for "
                f"{gops} {'GOP' if gops == 1 else 'GOPs'} of at least {SIZE.least_gop_bytes}; "
                "raise it, use longer GOPs or a smaller picture"
            )
        return room
