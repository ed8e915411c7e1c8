"""What every writer must know of the pictures it gets."""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction

from gsvrcodec.container.header import ColourInfo

#: Near-lossless: about 40 dB or more on the sample clips.
DEFAULT_CRF = 8
DEFAULT_CODEC_PRESET = "veryfast"


@dataclass(frozen=True, slots=True, kw_only=True)
class OutputInfo:
    """The pictures to come, and how to code them."""

    width: int  #: pixels
    height: int  #: pixels
    time_base: Fraction  #: seconds a tick
    rate: Fraction  #: mean frames a second
    frames: int  #: how many pictures will come
    first_frame: int = 0  #: number of the first picture in the film, from 0
    sample_aspect: Fraction = Fraction(1)  #: width of a pixel over its height
    rotation: int = 0  #: degrees clockwise that a player turns the picture by
    colour: ColourInfo = field(default_factory=ColourInfo)
    crf: int = DEFAULT_CRF  #: H.264 quality, 0 (best) to 51
    codec_preset: str = DEFAULT_CODEC_PRESET  #: x264's effort
    threads: int = 0  #: of the output's encoder; 0 = all cores
