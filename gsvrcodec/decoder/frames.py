"""Results of a decoder: frames, batches of frames, and metadata of the video."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from math import isfinite
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.bitstream.header import ColourInfo
from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.bitstream.tags import Tags
from gsvrcodec.errors import CorruptError, LimitError
from gsvrcodec.render import Codes, as_tensor

if TYPE_CHECKING:
    from gsvrcodec.render.backend import Tensor

_log = logging.getLogger(__name__)

#: Tolerance of a time in seconds against the timestamp that it stands for, ticks.
_TICK_TOLERANCE = Fraction(1, 10**6)


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One decoded picture."""

    #: (H, W, 3) red, green, blue: uint8, or uint16 of more than 8 bits; a NumPy array, or, on a GPU
    #: and where `open` was asked for `tensors`, a torch tensor: see `tensor`
    data: Codes
    index: int  #: frame number, from 0
    pts: int  #: presentation timestamp, ticks of the time base
    duration: int  #: display duration, ticks; 0 = not known
    pts_seconds: float  #: presentation timestamp, seconds
    duration_seconds: float  #: display duration, seconds; 0 = not known

    @property
    def tensor(self) -> Tensor:
        """`data` as a torch tensor, in the same memory; imports torch."""
        return as_tensor(self.data)


@dataclass(frozen=True, slots=True, eq=False)
class FrameBatch:
    """Several decoded pictures, in the requested order."""

    data: Codes  #: (F, H, W, 3) red, green, blue; types as of `Frame.data`
    index: NDArray[np.int64]  #: (F,) frame numbers, from 0
    pts: NDArray[np.int64]  #: (F,) presentation timestamps, ticks of the time base
    duration: NDArray[np.int64]  #: (F,) display durations, ticks; 0 = not known
    pts_seconds: NDArray[np.float64]  #: (F,) presentation timestamps, seconds
    duration_seconds: NDArray[np.float64]  #: (F,) display durations, seconds; 0 = not known

    @property
    def tensor(self) -> Tensor:
        """`data` as a torch tensor, in the same memory; imports torch."""
        return as_tensor(self.data)

    def __len__(self) -> int:
        """Return the number of frames F."""
        return len(self.data)

    def __getitem__(self, position: int) -> Frame:
        """Return one frame of the batch."""
        return Frame(
            data=self.data[position],
            index=int(self.index[position]),
            pts=int(self.pts[position]),
            duration=int(self.duration[position]),
            pts_seconds=float(self.pts_seconds[position]),
            duration_seconds=float(self.duration_seconds[position]),
        )

    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames one by one."""
        return (self[position] for position in range(len(self)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Metadata:
    """Properties of the video in a .gsvr file."""

    width: int  #: pixels
    height: int  #: pixels
    frames: int  #: frames in the video
    gops: int  #: GOPs in the video
    gaussians: int  #: sum over all GOPs, those carried over included
    time_base: Fraction  #: seconds a tick
    begin_seconds: Fraction  #: timestamp of the first frame
    end_seconds: Fraction  #: end of the last frame
    average_rate: Fraction  #: mean frame rate, frames a second
    sample_aspect: Fraction  #: width of a pixel over its height
    rotation: int  #: degrees clockwise that a player turns the picture by
    mirrored: bool  #: whether a player mirrors the picture left to right before it turns it
    bit_depth: int  #: bits a sample of the source
    colour: ColourInfo  #: colour tags of the source
    version: str  #: bitstream version
    size_bytes: int  #: size of the whole file
    streams_bytes: int  #: size of the copied streams in the file
    settings: dict[str, Any]  #: settings of the encoder; empty = not recorded
    tags: Tags  #: titles, languages and chapters; empty = the source had none

    @property
    def duration_seconds(self) -> Fraction:
        """Duration of the video, seconds."""
        return self.end_seconds - self.begin_seconds

    @property
    def bpp(self) -> float:
        """Bits a pixel and frame, without copied streams."""
        bits = 8 * (self.size_bytes - self.streams_bytes)
        return bits / (self.frames * self.width * self.height)

    def ticks(self, seconds: float | Fraction) -> Fraction:
        """Return a time in ticks; within `_TICK_TOLERANCE` of a whole number it is rounded."""
        if not isfinite(seconds):
            raise ValueError(f"a time in seconds must be finite, not {seconds}")
        ticks = Fraction(seconds) / self.time_base
        whole = round(ticks)
        return Fraction(whole) if abs(ticks - whole) <= _TICK_TOLERANCE else ticks

    def shown(self, seconds: float | Fraction) -> Fraction:
        """Return a time in ticks; raise `ValueError` if the video shows no frame at that time."""
        ticks = self.ticks(seconds)
        if not self.begin_seconds <= ticks * self.time_base < self.end_seconds:
            raise ValueError(f"nothing is shown at {seconds} s: {self.span}")
        return ticks

    @property
    def span(self) -> str:
        """Start and end of the video in words, for messages."""
        begin, end = float(self.begin_seconds), float(self.end_seconds)
        return f"the video runs from {begin:.6g} s to {end:.6g} s"

    @classmethod
    def of(cls, reader: GsvrReader) -> Metadata:
        """Return the metadata from header, index and auxiliary chunks; no GOP is read."""
        header = reader.header
        return cls(
            **_extent(reader),
            width=header.width,
            height=header.height,
            time_base=header.time_base,
            sample_aspect=header.sample_aspect,
            rotation=header.rotation,
            mirrored=header.mirrored,
            bit_depth=header.bit_depth,
            colour=header.colour,
            version=header.version,
            settings=_settings(reader),
            tags=_tags(reader),
        )

    def extended(self, reader: GsvrReader) -> Metadata:
        """Return the metadata after more of a pipe came."""
        return replace(self, **_extent(reader))


def _extent(reader: GsvrReader) -> dict[str, Any]:
    """Return how much there is of the video, as fields of `Metadata`."""
    gops, base = reader.gops, reader.header.time_base
    begin = gops[0].start_pts * base
    end = (gops[-1].last_pts + max(gops[-1].last_duration, 1)) * base
    return {
        "frames": reader.frames,
        "gops": len(gops),
        "gaussians": reader.gaussians,
        "begin_seconds": begin,
        "end_seconds": end,
        "average_rate": reader.frames / (end - begin),
        "size_bytes": reader.size,
        "streams_bytes": sum(chunk.end - chunk.offset for chunk in reader.streams),
    }


def _settings(reader: GsvrReader) -> dict[str, Any]:
    """Return the encoder's settings; decoding does not need them, so damage only warns."""
    try:
        return reader.settings()
    except CorruptError as error:
        _log.warning("the encoder's settings cannot be read: %s", error)
        return {}


def _tags(reader: GsvrReader) -> Tags:
    """Return titles and chapters; decoding does not need them, so damage only warns."""
    try:
        return reader.tags()
    except (CorruptError, LimitError) as error:
        _log.warning("titles and chapters cannot be read: %s", error)
        return Tags()
