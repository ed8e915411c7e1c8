"""Reference encoders to compare with: x264, x265 and SVT-AV1, through PyAV."""

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
    """A reference encoder and its defaults."""

    encoder: str  #: FFmpeg's name of the encoder
    decoder: str  #: FFmpeg's name of the decoder of its streams
    title: str  #: name for tables and plots
    preset: str  #: default preset
    crfs: tuple[int, ...]  #: default CRF values, best quality first
    version: bytes | None = None  #: pattern of the encoder's version in its streams


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
    """A reference encoder with settings, such as `x264:key=12:preset=slow`."""

    codec: str  #: "x264", "x265" or "svtav1"
    preset: str  #: preset of the encoder
    #: frames between key frames; None = encoder's choice, "same" = mean length of our GOPs
    key: int | Literal["same"] | None = None
    tune: str | None = None  #: tuning of the encoder; None = encoder's default
    #: input of the encoder: the source's own YCbCr where it has such, or the RGB that is compared
    input: Literal["source", "rgb"] = "source"

    @property
    def label(self) -> str:
        """Encoder and settings in words, for tables and plots."""
        words = [_LIBRARIES[self.codec].title, self.preset]
        if self.tune is not None:
            words.append(f"tune {self.tune}")
        if self.key is not None:
            words.append("all intra" if self.key == 1 else f"key {self.key}")
        if self.input == "rgb":
            words.append("from RGB")
        return " ".join(words)


@dataclass(frozen=True, slots=True, kw_only=True)
class Point:
    """One encode of the source at one CRF."""

    crf: int
    bytes: int  #: size of the video stream, without container
    bpp: float  #: bits a pixel and frame
    key_frames: int
    quality: Quality
    encode_fps: float  #: encoded frames a second, with reading and conversion of the source
    decode_fps: float  #: decoded frames a second, from stream to RGB


@dataclass(frozen=True, slots=True, kw_only=True)
class Curve:
    """All encodes with one reference encoder."""

    label: str
    reference: Reference
    version: str | None  #: version of the encoder; None = not in its streams
    points: tuple[Point, ...]  #: best quality first

    @property
    def rate_curve(self) -> RateCurve:
        """Bits a pixel and frame over mean PSNR."""
        return RateCurve((point.quality.psnr_rgb, point.bpp) for point in self.points)

    @property
    def ms_ssim_curve(self) -> RateCurve | None:
        """Bits a pixel and frame over mean MS-SSIM in dB; None = the frames are too small."""
        pairs = [(point.quality.ms_ssim_db, point.bpp) for point in self.points]
        known = [(quality, bpp) for quality, bpp in pairs if quality is not None]
        return RateCurve(known) if len(known) == len(pairs) else None


def parse_reference(text: str) -> Reference:
    """Parse a reference such as `x264`, `x264:intra` or `svtav1:key=same:preset=4`.

    Raises:
        UsageError: The encoder or a setting is unknown, or PyAV was built without the encoder.
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
        elif setting == "input=rgb":
            reference = replace(reference, input="rgb")
        else:
            raise UsageError(
                f"{text}: {setting!r} is none of intra, key=N, key=same, "
                "preset=NAME, tune=NAME, input=rgb"
            )
    return reference


def measure(
    reference: Reference,
    video: VideoReader,
    frames: int,
    *,
    crfs: Sequence[int] | None = None,
    threads: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Curve:
    """Encode a source with a reference encoder at several CRF values and measure the results.

    Args:
        reference: The encoder; `key` must be a number or None.
        video: The source.
        frames: Number of frames of `video`.
        crfs: CRF values, best quality first; None = the defaults of the encoder.
        threads: Threads of encoder and decoder; 0 = all cores.
        progress: Called with the frames done and all frames, over all encodes.

    Raises:
        UsageError: The encoder rejects its settings or the pictures.
    """
    library = _LIBRARIES[reference.codec]
    points: list[Point] = []
    version = None
    ladder = library.crfs if crfs is None else crfs
    for crf in ladder:
        began = time.perf_counter()
        stream = encode_stream(
            source_frames(video)
            if reference.input == "source"
            else ycbcr_frames((source.rgb for source in video), video.info),
            video.info,
            library.encoder,
            encoder_options(reference, crf),
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
    """Return the quality of a coded stream against its source."""
    pictures = stream.pictures(library.decoder, threads)
    return Quality.of(
        PictureQuality.of(source.rgb, rgb) for source, rgb in zip(video, pictures, strict=True)
    )


def encoder_options(reference: Reference, crf: float) -> dict[str, str]:
    """Return the encoder's options by their names in FFmpeg; `key` must be a number or None."""
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
