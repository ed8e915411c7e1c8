"""Properties of an output video, shared by all writers."""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction

from gsvrcodec.bitstream.header import ColourInfo
from gsvrcodec.bitstream.tags import StreamTags, Tags
from gsvrcodec.video.timing import Span

#: Near-lossless: about 40 dB or more on the sample clips.
DEFAULT_CRF = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class OutputInfo:
    """Properties of the pictures of an output, and coding options."""

    width: int  #: pixels
    height: int  #: pixels
    time_base: Fraction  #: seconds a tick
    rate: Fraction  #: mean frame rate, frames a second
    frames: int  #: number of pictures; 0 = not known, but for numbered ones
    bit_depth: int = 8  #: bits a sample: 8 (uint8) or 10 (uint16, 0 to 1023)
    first_frame: int = 0  #: number of the first picture in the film, from 0
    sample_aspect: Fraction = Fraction(1)  #: width of a pixel over its height
    rotation: int = 0  #: degrees clockwise that a player turns the picture by
    mirrored: bool = False  #: whether a player mirrors the picture left to right before it turns it
    colour: ColourInfo = field(default_factory=ColourInfo)
    crf: int = DEFAULT_CRF  #: quality of H.264 or HEVC, 0 (lossless YCbCr) to 51
    codec_preset: str | None = None  #: effort of x264 or x265; None = by the writer
    threads: int = 0  #: threads of the output's encoder; 0 = all cores
    tags: Tags = field(default_factory=Tags)  #: titles, languages, chapters
    #: Copied sound and subtitles: tags, and a container file with that stream alone.
    streams: tuple[tuple[StreamTags, bytes], ...] = ()
    span: Span = field(default_factory=Span)  #: part of streams and chapters to keep
