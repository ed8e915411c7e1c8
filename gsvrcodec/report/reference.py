"""Other encoders to compare with: the libraries inside PyAV, on the same frames."""

from __future__ import annotations

import re
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from gsvrcodec.errors import UsageError
from gsvrcodec.report.curve import RateCurve
from gsvrcodec.report.quality import PictureQuality, Quality
from gsvrcodec.video.elementary import (
    ElementaryStream,
    encode_stream,
    has_encoder,
    source_frames,
    ycbcr_frames,
)
from gsvrcodec.video.read import VideoReader


@dataclass(frozen=True, slots=True, kw_only=True)
class _Library:
    """An encoder, and how it is told what we ask."""

    encoder: str  #: FFmpeg's name
    decoder: str  #: FFmpeg's name of the decoder for its streams
    title: str  #: as people write it
    preset: str  #: effort, unless another is asked for
    crfs: tuple[int, ...]  #: the ladder of qualities, best first
    version: bytes | None = None  #: pattern that finds its version in the stream


_LIBRARIES = {
    "x264": _Library(
        encoder="libx264",
        decoder="h264",
        title="x264",
        preset="medium",
        crfs=(16, 20, 24, 28, 32, 36, 40),
        version=rb"x264 - core (\d+ r\w+|\d+)",
    ),
    "x265": _Library(
        encoder="libx265",
        decoder="hevc",
        title="x265",
        preset="medium",
        crfs=(16, 20, 24, 28, 32, 36, 40),
        version=rb"x265 \(build \d+\) - ([\w.+-]+)",
    ),
    "svtav1": _Library(
        encoder="libsvtav1",
        decoder="libdav1d",
        title="SVT-AV1",
        preset="8",
        crfs=(12, 20, 28, 36, 44, 52, 58, 63),
    ),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Reference:
    """An encoder with its settings, such as `x264:key=12:preset=slow`."""

    codec: str  #: "x264", "x265" or "svtav1"
    preset: str  #: its effort
    #: frames from one key frame to the next; None = its own choice, "same" = as in our file
    key: int | Literal["same"] | None = None
    tune: str | None = None  #: what it optimises for; None = its own choice
    #: what it is given: the RGB pictures that are measured, or the source's own YCbCr
    input: Literal["rgb", "source"] = "rgb"

    @property
    def label(self) -> str:
        """The settings in words, for tables and plots."""
        words = [_LIBRARIES[self.codec].title, self.preset]
        if self.tune is not None:
            words.append(f"tune {self.tune}")
        if self.key is not None:
            words.append("all intra" if self.key == 1 else f"key {self.key}")
        if self.input == "source":
            words.append("from YCbCr")
        return " ".join(words)


@dataclass(frozen=True, slots=True, kw_only=True)
class Point:
    """One encode of the source at one quality setting."""

    crf: int
    bytes: int  #: of the video stream, without any container
    bpp: float  #: bits a pixel and frame
    key_frames: int
    quality: Quality
    encode_fps: float  #: frames a second; reading and converting the source included
    decode_fps: float  #: frames a second, from the stream to RGB


@dataclass(frozen=True, slots=True, kw_only=True)
class Curve:
    """All encodes with one reference."""

    label: str
    reference: Reference
    version: str | None  #: of the library; None = its streams do not say
    points: tuple[Point, ...]  #: best quality first

    @property
    def rate_curve(self) -> RateCurve:
        """Bits a pixel and frame over the mean PSNR of the frames."""
        return RateCurve((point.quality.psnr_rgb, point.bpp) for point in self.points)


def parse_reference(text: str) -> Reference:
    """Return what `x264`, `x264:intra` or `svtav1:key=same:preset=4` stands for.

    Raises:
        UsageError: there is no such encoder or setting, or this PyAV was built without it.
    """
    codec, *settings = text.split(":")
    if codec not in _LIBRARIES:
        raise UsageError(f"{codec!r} is not known: the encoders are {', '.join(_LIBRARIES)}")
    library = _LIBRARIES[codec]
    if not has_encoder(library.encoder):
        there = [name for name, other in _LIBRARIES.items() if has_encoder(other.encoder)]
        raise UsageError(
            f"{codec}: this PyAV was built without {library.encoder}; "
            f"it has {', '.join(there) or 'none of the encoders known here'}"
        )
    reference = Reference(codec=codec, preset=library.preset)
    for setting in settings:
        name, _, value = setting.partition("=")
        if setting == "intra":
            reference = replace(reference, key=1)
        elif setting == "key=same":
            reference = replace(reference, key="same")
        elif name == "key" and value.isascii() and value.isdigit() and int(value):
            reference = replace(reference, key=int(value))
        elif name == "preset" and value:
            reference = replace(reference, preset=value)
        elif name == "tune" and value:
            reference = replace(reference, tune=value)
        elif setting == "input=source":
            reference = replace(reference, input="source")
        else:
            raise UsageError(
                f"{text}: {setting!r} is none of intra, key=N, key=same, "
                "preset=NAME, tune=NAME, input=source"
            )
    return reference


def measure(
    reference: Reference,
    video: VideoReader,
    start: int,
    frames: int,
    *,
    crfs: Sequence[int] | None = None,
    threads: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Curve:
    """Encode a source with another encoder at several qualities and measure what comes out.

    Args:
        reference: the encoder; its `key` is a number, or None.
        video: the source.
        start: number of the first frame that `video` gives.
        frames: how many frames it gives.
        crfs: the quality settings, best first; None = the encoder's own ladder.
        threads: of encoder and decoder; 0 = all cores.
        progress: is told how many frames of all encodes are done, and how many there are.

    Raises:
        UsageError: the encoder refuses its settings or the pictures.
    """
    library = _LIBRARIES[reference.codec]
    points: list[Point] = []
    version = None
    ladder = library.crfs if crfs is None else crfs
    for crf in ladder:
        began = time.perf_counter()
        stream = encode_stream(
            source_frames(video.info, start, frames)
            if reference.input == "source"
            else ycbcr_frames((source.rgb for source in video), video.info),
            video.info,
            library.encoder,
            _options(reference, crf),
            threads,
        )
        encoded = time.perf_counter()
        deque(stream.pictures(library.decoder, threads), maxlen=0)
        ended = time.perf_counter()
        points.append(
            Point(
                crf=crf,
                bytes=stream.size,
                bpp=8 * stream.size / (frames * video.info.width * video.info.height),
                key_frames=stream.key_frames,
                quality=_quality(video, stream, library, threads),
                encode_fps=frames / (encoded - began),
                decode_fps=frames / (ended - encoded),
            )
        )
        if library.version and (found := re.search(library.version, stream.start)):
            version = found[1].decode()
        if progress is not None:
            progress(len(points) * frames, len(ladder) * frames)
    return Curve(label=reference.label, reference=reference, version=version, points=tuple(points))


def _quality(
    video: VideoReader, stream: ElementaryStream, library: _Library, threads: int
) -> Quality:
    """Compare a stream with its source."""
    pictures = stream.pictures(library.decoder, threads)
    return Quality.of(
        PictureQuality.of(source.rgb, rgb) for source, rgb in zip(video, pictures, strict=True)
    )


def _options(reference: Reference, crf: int) -> dict[str, str]:
    """Return the encoder's options, by FFmpeg's names."""
    options = {"preset": reference.preset, "crf": str(crf)}
    if reference.tune is not None:
        options["tune"] = reference.tune
    if reference.key is not None:
        options["g"] = str(reference.key)
    if reference.codec == "x264" and reference.key is not None:
        options |= {"keyint_min": str(reference.key), "sc_threshold": "0"}
    if reference.codec == "x265":
        private = ["log-level=error"]
        if reference.key is not None:
            private += [f"min-keyint={reference.key}", "scenecut=0", "open-gop=0"]
        options["x265-params"] = ":".join(private)
    return options
