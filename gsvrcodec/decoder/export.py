"""Export of a .gsvr file to a video file of another format."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

from gsvrcodec.ahead import ahead
from gsvrcodec.bitstream.source import Readable, path_of
from gsvrcodec.decoder.decoder import Decoder
from gsvrcodec.decoder.decoder import open as open_gsvr
from gsvrcodec.decoder.pictures import RequestedSize
from gsvrcodec.decoder.schedule import Number, Schedule, schedule
from gsvrcodec.errors import CorruptError, UsageError
from gsvrcodec.limits import Limits
from gsvrcodec.model.layers import Layers
from gsvrcodec.video.output import DEFAULT_CRF, OutputInfo
from gsvrcodec.video.timing import Span
from gsvrcodec.video.write import DEEP, WITH_STREAMS, Writer, muxer_of, open_writer

_log = logging.getLogger(__name__)

#: Greatest term of a sample aspect ratio: some formats store 8-bit numbers.
_MAX_ASPECT = 255


@dataclass(frozen=True, slots=True, kw_only=True)
class DecodeResult:
    """Result of `decode`."""

    frames: int  #: frames written
    lost_frames: int  #: damaged frames, left out
    complete: bool  #: False = the file was cut short or damaged, and `keep_going` was set


def decode(
    src: Readable,
    dst: str | os.PathLike[str] | None,
    *,
    muxer: str | None = None,
    start_frame: int = 0,
    frames: int | None = None,
    start_seconds: Number | None = None,
    stop_seconds: Number | None = None,
    fps: Number | None = None,
    speed: Number = 1,
    size: RequestedSize | None = None,
    layers: Layers = "all",
    bit_depth: int | None = None,
    overwrite: bool = False,
    keep_going: bool = False,
    crf: int = DEFAULT_CRF,
    codec_preset: str | None = None,
    threads: int = 0,
    device: str = "auto",
    limits: Limits | None = None,
    progress: Callable[[int, int | None], None] | None = None,
) -> DecodeResult:
    """Write a .gsvr file as a video: the stored frames, or frames at another rate and size.

    Args:
        src: The .gsvr file; "-" = the standard input; a URL, bytes or a binary file object. All
            frames of a pipe are written as they come; a part of it, or other times, wait for its
            end.
        dst: .mp4, .mkv, .y4m, a numbered .png; "-" or None = standard output.
        muxer: "mp4", "mkv", "y4m", "png", "md5" or "null"; None = by the suffix of `dst`.
        start_frame: First frame to write, from 0.
        frames: Number of frames to write; None = to the end. Fewer if the video ends before.
        start_seconds: Instead of `start_frame`: write frames that start at this time or later.
            Seconds on the clock of the video's timestamps.
        stop_seconds: Instead of `frames`: write frames that start before this time.
        fps: Constant frame rate of the output, rendered between the stored frames; over 0, at most
            1000. None = the stored frames, or their mean rate if `speed` is not 1.
        speed: Seconds of the film in one second of the output; over 0, at most 1000. Timestamps
            are divided by `speed`.
        size: Width and height of the output in pixels, where -1 keeps the aspect ratio and -2 also
            rounds to an even number; or a factor for both; None = as coded.
        layers: Gaussians to draw: "dynamic" = those that move against the median motion of their
            GOP, "static" = all others, or "all".
        bit_depth: Bits a sample of the output, 8 or 10; None = 10 for a source of more than 8 bits
            if the output is .mp4 (then as HEVC), .mkv or .y4m, else 8.
        overwrite: Replace an existing output.
        keep_going: Decode the undamaged GOPs of a damaged file.
        crf: Quality of H.264 or HEVC, 0 (best) to 51.
        codec_preset: Effort of x264 or x265, one of their preset names; None = "veryfast", and
            "ultrafast" for HEVC.
        threads: Threads for rendering and for the output's encoder; 0 = all cores.
        device: Device for rendering: "cpu", "cuda", "cuda:N", or "auto" = the first usable GPU,
            else the CPU.
        limits: Limits on the content; None = the defaults, or those of the environment.
        progress: Called with the number of frames done, and that of all frames, None = not known.

    Returns:
        How many frames were written, and how many were lost.

    Raises:
        DeviceError: The requested GPU is not usable.
        UsageError: Part of the film, size, rate or name of the output is invalid.
        OutputError: The output exists or cannot be written.
        CorruptError: The file is damaged, and `keep_going` is not set or no frame can be decoded.
        InputError, UnsupportedError: As `gsvrcodec.open`.
    """
    muxer = muxer_of(dst, muxer)
    with open_gsvr(
        src,
        size=size,
        layers=layers,
        bit_depth=_depth(bit_depth, muxer),
        threads=threads,
        device=device,
        arrays=True,
        limits=limits,
        keep_going=keep_going,
    ) as decoder:
        if muxer == "png":
            decoder.wait_for(None)  # so that no picture is written if one of them exists already
        plan = schedule(
            decoder,
            start_frame=start_frame,
            frames=frames,
            start_seconds=start_seconds,
            stop_seconds=stop_seconds,
            fps=fps,
            speed=speed,
        )
        info = _output_info(decoder, plan, muxer, crf, codec_preset, threads)
        with open_writer(
            dst, info, muxer=muxer, overwrite=overwrite, source=path_of(src)
        ) as writer:
            written = _write(decoder, plan, writer, progress)
        return DecodeResult(
            frames=written,
            lost_frames=decoder.lost_frames,
            complete=not (decoder.recovered or decoder.lost_frames),
        )


def _depth(asked: int | None, muxer: str) -> int | None:
    """Return the bits a sample of the output; None = as the source."""
    if asked not in (None, 8, 10):
        raise UsageError(f"the bit depth must be 8 or 10, not {asked}")
    return 8 if asked is None and muxer not in DEEP else asked


def _write(
    decoder: Decoder,
    plan: Schedule,
    writer: Writer,
    progress: Callable[[int, int | None], None] | None,
) -> int:
    """Write all pictures, rendered ahead, and return their number."""
    done = 0
    with closing(ahead(plan.pictures(decoder), decoder.batch, "gsvr-render")) as pictures:
        for picture in pictures:
            writer.write(picture.data, picture.pts, picture.duration)
            done += 1
            if progress is not None:
                progress(done, plan.total)
    if not done:
        raise CorruptError("none of these frames could be decoded")
    return done


def _output_info(
    decoder: Decoder,
    plan: Schedule,
    muxer: str,
    crf: int,
    codec_preset: str | None,
    threads: int,
) -> OutputInfo:
    """Return size, timing, colour and coding options of the output, and what it copies."""
    meta = decoder.known
    width, height = decoder.size
    extras = _extras(decoder, plan) if muxer in WITH_STREAMS else {}
    return OutputInfo(
        width=width,
        height=height,
        time_base=plan.time_base,
        rate=plan.rate,
        frames=plan.total or 0,
        bit_depth=decoder.bit_depth,
        first_frame=plan.first_frame,
        sample_aspect=_sample_aspect(decoder),
        rotation=meta.rotation,
        mirrored=meta.mirrored,
        colour=meta.colour,
        crf=crf,
        codec_preset=codec_preset,
        threads=threads,
        **extras,
    )


def _extras(decoder: Decoder, plan: Schedule) -> dict[str, Any]:
    """Return tags, copied streams and their span, as fields of `OutputInfo`."""
    meta = decoder.known
    span = Span(
        None if plan.start <= meta.begin_seconds else plan.start,
        None if plan.stop >= meta.end_seconds else plan.stop,
    )
    if plan.speed == 1:
        return {"tags": meta.tags, "streams": tuple(decoder.streams()), "span": span}
    if meta.streams_bytes:
        _log.warning("sound and subtitles are left out: they have one speed only")
    return {"tags": replace(meta.tags, chapters=())}


def _sample_aspect(decoder: Decoder) -> Fraction:
    """Return the sample aspect ratio that keeps the display aspect ratio at the output's size.

    Rounding of the size to whole or even pixels does not change the sample aspect ratio.
    """
    meta, (width, height) = decoder.known, decoder.size
    if abs(width * meta.height - height * meta.width) <= max(meta.width, meta.height):
        return meta.sample_aspect
    aspect = meta.sample_aspect * Fraction(meta.width * height, meta.height * width)
    return aspect.limit_denominator(_MAX_ASPECT)
