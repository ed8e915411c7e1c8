"""From a .gsvr file to a video file of another format, frame by frame."""

from __future__ import annotations

import logging
import os
from collections import deque
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

from gsvrcodec.decoder.decoder import Decoder
from gsvrcodec.decoder.decoder import open as open_gsvr
from gsvrcodec.decoder.pictures import RequestedSize
from gsvrcodec.decoder.schedule import Number, Schedule, TimedPicture, schedule
from gsvrcodec.errors import CorruptError, UsageError
from gsvrcodec.limits import Limits
from gsvrcodec.model.layers import Layers
from gsvrcodec.video.output import DEFAULT_CODEC_PRESET, DEFAULT_CRF, OutputInfo
from gsvrcodec.video.timing import Span
from gsvrcodec.video.write import DEEP, WITH_STREAMS, muxer_of, open_writer

_log = logging.getLogger(__name__)

#: Sample aspect ratios of some formats are fractions of 8-bit numbers.
_MAX_ASPECT = 255


@dataclass(frozen=True, slots=True, kw_only=True)
class DecodeResult:
    """What came of `decode`."""

    frames: int  #: frames written
    lost_frames: int  #: frames left out because they were damaged
    complete: bool  #: False = the file was cut short or damaged, and `keep_going` was set


def decode(
    src: str | os.PathLike[str],
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
    codec_preset: str = DEFAULT_CODEC_PRESET,
    threads: int = 0,
    device: str = "auto",
    limits: Limits | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> DecodeResult:
    """Write a .gsvr file as a video: its frames at their times, or new ones at any rate and size.

    Args:
        src: the .gsvr file.
        dst: .mp4, .mkv, .y4m, a numbered .png; "-" or None = standard output.
        muxer: "mp4", "mkv", "y4m", "png", "md5" or "null"; None = by the suffix of `dst`.
        start_frame: first frame to write, from 0.
        frames: how many to write; None = to the end. Fewer come if the video ends before.
        start_seconds: instead of `start_frame`: write what starts at this time or later. Seconds
            on the clock of the video's timestamps.
        stop_seconds: instead of `frames`: write what starts before this time.
        fps: pictures a second of the output, at a constant rate, rendered between frames; over 0,
            at most 1000. None = the frames as they are, or their mean rate if `speed` is not 1.
        speed: seconds of the film that pass in one second of the output; over 0, at most 1000.
            Times are divided by it.
        size: width and height of the output in pixels, where -1 is what keeps the shape and -2
            the even number next to that; or a factor for both; None = as coded.
        layers: "dynamic" = only the Gaussians that move otherwise than most, "static" = only the
            others, "all".
        bit_depth: bits of a sample of the output, 8 or 10; None = 10 for a source of more than 8
            bits where the output is .mp4 (then as HEVC), .mkv or .y4m, else 8.
        overwrite: replace an output that exists.
        keep_going: decode what is left of a damaged file.
        crf: quality of H.264 or HEVC, 0 (best) to 51.
        codec_preset: effort of their encoders, as x264 and x265 name it.
        threads: to render and to code with; 0 = all cores.
        device: what renders: "cpu", "cuda", "cuda:N", or "auto" = the first GPU if it is usable.
        limits: what to accept; None = the defaults, or the environment's.
        progress: is told how many frames are done, and how many there are to do.

    Raises:
        DeviceError: the GPU that was asked for is not usable.
        UsageError: the part of the film, the size, a rate or the output's name does not fit.
        OutputError: the output exists or cannot be written.
        CorruptError: the file is damaged, and `keep_going` is not set or nothing is left of it.
        InputError, UnsupportedError: as `gsvrcodec.open`.
    """
    muxer = muxer_of(dst, muxer)
    if bit_depth not in (None, 8, 10):
        raise UsageError(f"the bit depth must be 8 or 10, not {bit_depth}")
    if bit_depth is None and muxer not in DEEP:
        bit_depth = 8
    with open_gsvr(
        src,
        size=size,
        layers=layers,
        bit_depth=bit_depth,
        threads=threads,
        device=device,
        arrays=True,
        limits=limits,
        keep_going=keep_going,
    ) as decoder:
        plan = schedule(
            decoder,
            start_frame=start_frame,
            frames=frames,
            start_seconds=start_seconds,
            stop_seconds=stop_seconds,
            fps=fps,
            speed=speed,
        )
        info = _output_info(decoder, plan, crf, codec_preset, threads)
        if muxer in WITH_STREAMS:
            info = replace(info, **_extras(decoder, plan))
        done = 0
        with (
            open_writer(dst, info, muxer=muxer, overwrite=overwrite, source=src) as writer,
            closing(_ahead(plan.pictures(decoder), decoder.batch)) as pictures,
        ):
            for picture in pictures:
                writer.write(picture.data, picture.pts, picture.duration)
                done += 1
                if progress is not None:
                    progress(done, plan.total)
            if not done:
                raise CorruptError("none of these frames could be decoded")
        return DecodeResult(
            frames=done,
            lost_frames=decoder.lost_frames,
            complete=not (decoder.recovered or decoder.lost_frames),
        )


def _ahead(pictures: Iterator[TimedPicture], count: int) -> Generator[TimedPicture, None, None]:
    """Yield what `pictures` does; a thread makes the next `count` while the caller has the last."""
    with ThreadPoolExecutor(1, "gsvr-render") as worker:
        try:
            coming = deque(worker.submit(next, pictures, None) for _ in range(count))
            while (picture := coming.popleft().result()) is not None:
                coming.append(worker.submit(next, pictures, None))
                yield picture
        finally:
            worker.shutdown(cancel_futures=True)


def _output_info(
    decoder: Decoder, plan: Schedule, crf: int, codec_preset: str, threads: int
) -> OutputInfo:
    """Return what the writer must know."""
    meta = decoder.metadata
    width, height = decoder.size
    return OutputInfo(
        width=width,
        height=height,
        time_base=plan.time_base,
        rate=plan.rate,
        frames=plan.total,
        bit_depth=decoder.bit_depth,
        first_frame=plan.first_frame,
        sample_aspect=_sample_aspect(decoder),
        rotation=meta.rotation,
        mirrored=meta.mirrored,
        colour=meta.colour,
        crf=crf,
        codec_preset=codec_preset,
        threads=threads,
    )


def _extras(decoder: Decoder, plan: Schedule) -> dict[str, Any]:
    """Return what goes into the output beside the pictures: fields of `OutputInfo`."""
    meta = decoder.metadata
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
    """Return the shape of a pixel that leaves the shape of the picture as it was.

    A size that is only rounded to whole or even pixels does not change it.
    """
    meta, (width, height) = decoder.metadata, decoder.size
    if abs(width * meta.height - height * meta.width) <= max(meta.width, meta.height):
        return meta.sample_aspect
    aspect = meta.sample_aspect * Fraction(meta.width * height, meta.height * width)
    return aspect.limit_denominator(_MAX_ASPECT)
