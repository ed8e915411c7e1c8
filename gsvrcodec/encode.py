"""The encoder in one page: read, slice, fit each GOP, pack, write."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from gsvrcodec.container.header import Header
from gsvrcodec.container.writer import GsvrWriter
from gsvrcodec.errors import NotAVideoError
from gsvrcodec.files import atomic_output, check_output
from gsvrcodec.fit.flow import flow_estimator
from gsvrcodec.fit.gop import GopTask, encode_gop
from gsvrcodec.fit.plan import allocate
from gsvrcodec.fit.settings import EncodeSettings
from gsvrcodec.fit.slicing import analyse, slice_gops
from gsvrcodec.video import SourceFrame, VideoInfo, VideoReader, open_video


@dataclass(frozen=True, slots=True)
class Progress:
    """State of an encode after a GOP, or before the first (`gop` 0)."""

    gop: int  #: GOPs done
    gops: int  #: GOPs in all
    frames_done: int
    frames: int  #: in all
    psnr: float | None  #: dB, mean of the frames done; None = none yet
    seconds_per_frame: float | None  #: wall time so far over frames done
    eta_seconds: float | None  #: wall time still to go


@dataclass(frozen=True, slots=True)
class EncodeResult:
    """What an encode came to."""

    path: Path
    frames: int
    gops: int
    gaussians: int  #: in all GOPs
    bytes: int  #: of the file
    bpp: float  #: bits a pixel and frame, the whole file
    psnr: float  #: dB, mean over frames, of 8-bit RGB as decoded
    float_psnr: float  #: dB, the same before quantisation
    seconds: float  #: wall time


def encode(
    src: str | os.PathLike[str],
    dst: str | os.PathLike[str],
    *,
    overwrite: bool = False,
    progress: Callable[[Progress], None] | None = None,
    **settings: Any,
) -> EncodeResult:
    """Encode a video file as a .gsvr file.

    The source is read twice, frame by frame: once for its motion, once to be fitted. `dst`
    appears when it is whole.

    Args:
        src: any video that FFmpeg reads.
        dst: path of the .gsvr file.
        overwrite: replace `dst` if it exists.
        progress: called after each GOP.
        **settings: fields of `EncodeSettings`.

    Raises:
        UsageError: settings contradict each other or do not fit the video.
        InputError: `src` cannot be read; NotAVideoError: it has no video.
        OutputError: `dst` cannot be written.
    """
    began = time.perf_counter()
    chosen = EncodeSettings(**settings)
    check_output(dst, overwrite=overwrite, source=src)
    with open_video(
        src, crop=chosen.crop, start_frame=chosen.start_frame, frames=chosen.frames
    ) as video:
        size = (video.info.width, video.info.height)
        steps = analyse((frame.rgb for frame in video), flow_estimator(chosen.flow))
        gops = slice_gops(steps, chosen.gop, minimum=chosen.gop_min, maximum=chosen.gop_max)
        if not gops:
            raise NotAVideoError(f"{src} has no video frames")
        gaussians = allocate(gops, size, chosen)
        frames = gops[-1].stop
        state = Progress(0, len(gops), 0, frames, None, None, None)
        psnr = float_psnr = 0.0
        with atomic_output(dst, overwrite=overwrite) as path, path.open("w+b") as file:
            writer = GsvrWriter(file, _header(video.info))
            writer.add_auxiliary(b"sett", json.dumps(chosen.recorded()).encode())
            _report(progress, state)
            for gop, count, shots in zip(gops, gaussians, _by_gop(video, gops), strict=True):
                seconds = _seconds(chosen, began, frames, gop)
                done = encode_gop(_task(shots, gop, count, chosen, seconds))
                writer.add_gop(done.payload)
                psnr += done.psnr * len(gop)
                float_psnr += done.float_psnr * len(gop)
                state = _advance(state, len(gop), psnr / gop.stop, time.perf_counter() - began)
                _report(progress, state)
            writer.close()
            size_bytes = writer.size
    return EncodeResult(
        path=Path(dst),
        frames=frames,
        gops=len(gops),
        gaussians=sum(gaussians),
        bytes=size_bytes,
        bpp=8 * size_bytes / (frames * size[0] * size[1]),
        psnr=psnr / frames,
        float_psnr=float_psnr / frames,
        seconds=time.perf_counter() - began,
    )


def _header(info: VideoInfo) -> Header:
    return Header(
        width=info.width,
        height=info.height,
        time_base=info.time_base,
        sample_aspect=info.sample_aspect,
        rotation=info.rotation,
        bit_depth=info.bit_depth,
        colour=info.colour,
    )


def _by_gop(video: VideoReader, gops: Sequence[range]) -> Iterator[list[SourceFrame]]:
    """Frames of one GOP after another; only one GOP is held."""
    frames = iter(video)
    for gop in gops:
        yield [next(frames) for _ in gop]


def _task(
    shots: list[SourceFrame],
    gop: range,
    gaussians: int,
    settings: EncodeSettings,
    seconds: float | None,
) -> GopTask:
    return GopTask(
        frames=np.stack([shot.rgb for shot in shots]),
        pts=np.array([shot.pts for shot in shots], np.int64),
        durations=np.array([shot.duration for shot in shots], np.int64),
        first_frame=gop.start,
        gaussians=gaussians,
        settings=settings,
        seconds=seconds,
    )


def _seconds(settings: EncodeSettings, began: float, frames: int, gop: range) -> float | None:
    """This GOP's share of the wall time that is left of the budget."""
    if settings.time_budget is None:
        return None
    left = settings.time_budget * frames - (time.perf_counter() - began)
    return max(0.0, left) * len(gop) / (frames - gop.start)


def _advance(state: Progress, frames: int, psnr: float, elapsed: float) -> Progress:
    done = state.frames_done + frames
    pace = elapsed / done
    return replace(
        state,
        gop=state.gop + 1,
        frames_done=done,
        psnr=psnr,
        seconds_per_frame=pace,
        eta_seconds=pace * (state.frames - done),
    )


def _report(progress: Callable[[Progress], None] | None, state: Progress) -> None:
    if progress is not None:
        progress(state)
