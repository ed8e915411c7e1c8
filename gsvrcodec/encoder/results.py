"""Results of an encode."""

from __future__ import annotations

import builtins
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any


@dataclass(frozen=True, slots=True, kw_only=True)
class EncodedGop:
    """A finished GOP."""

    frames: range  #: numbers of its frames in the file
    psnr: float  #: dB, mean of the frames that a decoder will show
    float_psnr: float  #: dB, the same before quantisation
    seconds: float  #: wall time
    qscale: float | None = None  #: of the quantiser steps; None = bits over the range
    plate_bytes: int = 0  #: of the payload, those of a plate, which other GOPs may have, too
    payload: bytes = field(default=b"", repr=False)  #: of its chunk, unless that is kept elsewhere


@dataclass(frozen=True, slots=True)
class GopStats:
    """Result of one GOP."""

    first_frame: int
    frames: int
    cut: bool  #: it starts with a new shot
    key: bool  #: it needs no other GOP
    motion: float  #: sum of its motion, pixels of the analysed frame
    gaussians: int
    bytes: int  #: of its payload
    bpp: float  #: of its payload
    psnr: float  #: dB, mean over its frames, of 8-bit RGB as decoded
    float_psnr: float  #: dB, the same before quantisation
    seconds: float  #: wall time of its fit
    qscale: float | None  #: of the quantiser steps; None = bits over the range


@dataclass(frozen=True, slots=True)
class EncodeResult:
    """Result of an encode."""

    path: Path | None  #: None = it went to memory or to a file object
    frames: int
    gops: int
    key_gops: int  #: of these, GOPs that need no other
    gaussians: int  #: sum over all GOPs; those carried over count in each
    bytes: int  #: of the file
    bpp: float  #: bits a pixel and frame, copied streams left out
    bitrate: float  #: bits a second, copied streams left out
    psnr: float  #: dB, mean over frames, of 8-bit RGB as decoded
    float_psnr: float  #: dB, the same before quantisation
    seconds: float  #: wall time
    gop_stats: tuple[GopStats, ...]
    data: builtins.bytes | None = field(default=None, repr=False)  #: the file, if it went to memory

    def to_dict(self) -> dict[str, Any]:
        """Return all of it but the file, as JSON can hold it."""
        content = asdict(self)
        del content["data"]
        return content | {"path": None if self.path is None else str(self.path)}
