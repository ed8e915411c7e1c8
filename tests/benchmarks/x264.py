"""H.264 to compare with: x264, preset medium, in MP4; and the CRF that meets a rate or a PSNR."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from math import log
from pathlib import Path
from typing import Literal

import av
import numpy as np
from av.video.reformatter import VideoReformatter

from gsvrcodec.report.reference import Reference, encoder_options
from gsvrcodec.video import Rgb
from gsvrcodec.video.colour import KNOWN_MATRICES, to_rgb
from gsvrcodec.video.elementary import ycbcr_frames
from tests.benchmarks.footage import Footage

#: Good enough, and the usual change with one CRF: dB, and the logarithm of the rate.
_TOLERANCE = {"psnr": 0.03, "bpp": 0.005}
_SLOPE = {"psnr": 0.55, "bpp": 0.115}
#: Encodes to look for a CRF, and the first one.
_TRIES = 8
_FIRST_CRF = 26.0
#: CRF 0 would be lossless.
_CRF_RANGE = (1.0, 51.0)


@dataclass(frozen=True, slots=True)
class Encode:
    """One file of x264."""

    path: Path
    crf: float
    bpp: float  #: bits a pixel and frame of the video stream, without container and parameter sets
    psnr: float  #: dB, mean of the frames

    def pictures(self, threads: int = 0) -> Iterator[Rgb]:
        """Yield the decoded pictures; `threads` 0 = all cores."""
        return pictures(self.path, threads)


def label(key: int | None) -> str:
    """Name the encoder with its distance of key frames; None = x264's default, 250 at most."""
    return Reference(codec="x264", preset="medium", key=key).label


def encode(footage: Footage, path: Path, crf: float, key: int | None = None) -> Encode:
    """Encode as gsvrreport does for `x264` or `x264:key=N`, but into a file."""
    info, size = footage.info, 0
    rate = info.average_rate or Fraction(25)
    options = encoder_options(Reference(codec="x264", preset="medium", key=key), crf)
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=rate, options=options)
        stream.width, stream.height = info.width, info.height
        for number, frame in enumerate(footage.samples or ycbcr_frames(footage.pictures, info)):
            if number == 0:
                stream.pix_fmt = frame.format.name
                context = stream.codec_context
                context.colorspace, context.color_range = frame.colorspace, frame.color_range
            frame.pts, frame.time_base = number, 1 / rate
            for packet in stream.encode(frame):
                size += packet.size
                container.mux(packet)
        for packet in stream.encode(None):
            size += packet.size
            container.mux(packet)
    return Encode(path, crf, 8 * size / footage.pixels, footage.psnr(pictures(path)))


def rgb_of() -> Callable[[av.VideoFrame], Rgb]:
    """Return a faster `to_rgb` for frames of one file.

    `VideoFrame.to_ndarray` sets up a conversion for each frame, which takes longer than the
    conversion itself; here all frames share one.
    """
    reformatter = VideoReformatter()

    def convert(frame: av.VideoFrame) -> Rgb:
        if frame.colorspace not in KNOWN_MATRICES:
            return to_rgb(frame)
        rgb = reformatter.reformat(frame, format="rgb24").to_ndarray()
        return rgb.astype(np.uint8, copy=False)

    return convert


def pictures(path: Path, threads: int = 0) -> Iterator[Rgb]:
    """Decode a file with libavcodec's frame and slice threads; `threads` 0 = all cores."""
    convert = rgb_of()
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        stream.thread_type, stream.thread_count = "AUTO", threads
        for frame in container.decode(stream):
            yield convert(frame)


def match(
    footage: Footage,
    path: Path,
    key: int | None,
    wanted: float,
    by: Literal["psnr", "bpp"],
) -> Encode:
    """Leave at `path` the file that is nearest to a PSNR in dB, or to a rate in bits a pixel."""

    def tried(crf: float) -> tuple[Encode, float]:
        result = encode(footage, path, crf, key)
        if by == "psnr":
            return result, result.psnr - wanted
        return result, log(result.bpp / wanted)

    crf = nearest_crf(lambda crf: tried(crf)[1], _SLOPE[by], _TOLERANCE[by])
    return tried(crf)[0]


def nearest_crf(excess: Callable[[float], float], slope: float, tolerance: float) -> float:
    """Return the CRF that brings an excess, which falls by about `slope` a CRF, nearest to 0."""
    found: dict[float, float] = {}
    crf = _FIRST_CRF
    while crf not in found and len(found) < _TRIES:
        found[crf] = excess(crf)
        if abs(found[crf]) <= tolerance:
            break
        above = [c for c, value in found.items() if value > 0]
        below = [c for c, value in found.items() if value <= 0]
        if above and below:
            low, high = max(above), min(below)
            crf = low + (high - low) * found[low] / (found[low] - found[high])
        else:
            crf += found[crf] / slope
        crf = round(min(max(crf, _CRF_RANGE[0]), _CRF_RANGE[1]), 2)
    return min(found, key=lambda crf: abs(found[crf]))
