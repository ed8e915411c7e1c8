"""From a .gsvr file to a video file of another format, frame by frame."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass

from gsvrcodec.decode import open as open_gsvr
from gsvrcodec.errors import CorruptError, UsageError
from gsvrcodec.frames import Metadata
from gsvrcodec.limits import Limits
from gsvrcodec.video.output import DEFAULT_CODEC_PRESET, DEFAULT_CRF, OutputInfo
from gsvrcodec.video.write import muxer_of, open_writer

#: Rates of containers are fractions of 32-bit numbers.
_MAX_RATE_DENOMINATOR = 100_000


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
    overwrite: bool = False,
    keep_going: bool = False,
    crf: int = DEFAULT_CRF,
    codec_preset: str = DEFAULT_CODEC_PRESET,
    threads: int = 0,
    limits: Limits | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> DecodeResult:
    """Write the frames of a .gsvr file as a video with the original timestamps.

    Args:
        src: the .gsvr file.
        dst: .mp4, .mkv, .y4m, a numbered .png; "-" or None = standard output.
        muxer: "mp4", "mkv", "y4m", "png", "md5" or "null"; None = by the suffix of `dst`.
        start_frame: first frame to write, from 0.
        frames: how many to write; None = to the end. Fewer come if the video ends before.
        overwrite: replace an output that exists.
        keep_going: decode what is left of a damaged file.
        crf: quality of H.264, 0 (best) to 51.
        codec_preset: effort of the H.264 encoder, as x264 names it.
        threads: to render and to code with; 0 = all cores.
        limits: what to accept; None = the defaults, or the environment's.
        progress: is told how many frames are done, and how many there are to do.

    Raises:
        UsageError: the frame range or the output's name does not fit.
        OutputError: the output exists or cannot be written.
        CorruptError: the file is damaged, and `keep_going` is not set or nothing is left of it.
        InputError, UnsupportedError: as `gsvrcodec.open`.
    """
    muxer_of(dst, muxer)
    with open_gsvr(src, threads=threads, limits=limits, keep_going=keep_going) as decoder:
        stop = _stop(len(decoder), start_frame, frames)
        total = stop - start_frame
        info = _output_info(decoder.metadata, start_frame, total, crf, codec_preset, threads)
        done = 0
        with open_writer(dst, info, muxer=muxer, overwrite=overwrite, source=src) as writer:
            for frame in decoder.frames(start_frame, stop):
                writer.write(frame.data, frame.pts, frame.duration)
                done += 1
                if progress is not None:
                    progress(done, total)
            if not done:
                raise CorruptError("none of these frames could be decoded")
        return DecodeResult(
            frames=done,
            lost_frames=decoder.lost_frames,
            complete=not (decoder.recovered or decoder.lost_frames),
        )


def _stop(length: int, start_frame: int, frames: int | None) -> int:
    """Return the first frame not to write."""
    if not 0 <= start_frame < length:
        raise UsageError(f"frame {start_frame} is out of range: the video has {length} frames")
    if frames is not None and frames < 1:
        raise UsageError(f"the number of frames must be 1 or more, not {frames}")
    return length if frames is None else min(length, start_frame + frames)


def _output_info(
    meta: Metadata, first: int, frames: int, crf: int, codec_preset: str, threads: int
) -> OutputInfo:
    """Return what the writer must know."""
    return OutputInfo(
        width=meta.width,
        height=meta.height,
        time_base=meta.time_base,
        rate=meta.average_rate.limit_denominator(_MAX_RATE_DENOMINATOR),
        frames=frames,
        first_frame=first,
        sample_aspect=meta.sample_aspect,
        rotation=meta.rotation,
        colour=meta.colour,
        crf=crf,
        codec_preset=codec_preset,
        threads=threads,
    )
