"""The encoder in one page: read, slice, fit each GOP, pack, write."""

from __future__ import annotations

import io
import json
import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, suppress
from dataclasses import asdict, replace
from fractions import Fraction
from pathlib import Path
from typing import Any, BinaryIO

from gsvrcodec.bitstream.chunk import METADATA_TYPE, SETTINGS_TYPE, STREAMS_TYPE
from gsvrcodec.bitstream.header import Header
from gsvrcodec.bitstream.tags import Tags
from gsvrcodec.bitstream.writer import GsvrWriter
from gsvrcodec.encoder.analysis import FrameStats, analyse
from gsvrcodec.encoder.background import still_shots
from gsvrcodec.encoder.checkpoint import Checkpoint
from gsvrcodec.encoder.job_queue import fit_backgrounds, processes_for, tasks
from gsvrcodec.encoder.plan import longest_gop, plan
from gsvrcodec.encoder.progress import Meter, Progress
from gsvrcodec.encoder.results import EncodeResult, GopStats
from gsvrcodec.encoder.settings import EncodeSettings
from gsvrcodec.encoder.slicing import slice_gops
from gsvrcodec.encoder.verify import verify_file
from gsvrcodec.encoder.workers import FittedGop, fit_gops
from gsvrcodec.errors import NotAVideoError, UsageError
from gsvrcodec.files import check_output, fingerprint, gathered_output, is_stream
from gsvrcodec.fit.flow import flow_estimator
from gsvrcodec.render.device import choose_device
from gsvrcodec.versions import versions
from gsvrcodec.video import (
    Extras,
    Rgb,
    Span,
    VideoInfo,
    VideoReader,
    open_video,
    read_extras,
    reading_options,
    rereadable,
)

__all__ = ["EncodeResult", "GopStats", "Progress", "encode"]


def encode(
    src: str | os.PathLike[str],
    dst: str | os.PathLike[str],
    *,
    overwrite: bool = False,
    resume: bool = False,
    verify: bool = False,
    progress: Callable[[Progress], None] | None = None,
    **settings: Any,
) -> EncodeResult:
    """Encode a video file as a .gsvr file.

    The source is read three times, frame by frame: for its motion, for what stands still, and to
    be fitted. `dst` appears when it is whole; until then finished GOPs are kept in `dst` + ".part".

    Args:
        src: any video that FFmpeg reads, numbered pictures such as in_%04d.png, or "-" = the
            standard input.
        dst: path of the .gsvr file.
        overwrite: replace `dst` if it exists, and what an interrupted encode has left of it.
        resume: go on with what an interrupted encode has left, if anything; the file will be the
            same as if there had been no interruption, unless there is a time budget.
        verify: read the source once more, and compare what was written with it.
        progress: called before the first GOP and after each.
        **settings: fields of `EncodeSettings`.

    Raises:
        DeviceError: the GPU that was asked for is not usable, or its memory does not suffice.
        UsageError: settings contradict each other or do not fit the video.
        InputError: `src` cannot be read; NotAVideoError: it has no video.
        OutputError: `dst` cannot be written, or what is left of it does not fit.
        WorkerError: a process died.
        VerificationError: what was written is not what was encoded.
    """
    began = time.perf_counter()
    chosen = EncodeSettings(**settings)
    chosen = replace(chosen, device=choose_device(chosen.device))
    check_output(dst, overwrite=overwrite, source=src)
    source = fingerprint(src)
    beside = Path(dst) if source and not is_stream(dst) else None
    if resume and beside is None:
        raise UsageError("--resume needs an input that can be read again and an output on a disk")
    begun_with = {"versions": versions(), **source, "settings": chosen.recorded()}
    with (
        rereadable(src) as path,
        open_video(path, **reading_options(asdict(chosen))) as video,
        Checkpoint(beside, begun_with, resume=resume, restart=overwrite) as parts,
    ):
        steps, shown = _analysis(video, chosen, parts)
        size = video.info.width, video.info.height
        duration = float((shown[1] - shown[0]) * video.info.time_base)
        longest = longest_gop(steps, size, chosen, seconds=duration)
        gops = slice_gops(steps, chosen.gop, minimum=chosen.gop_min, maximum=longest)
        if not gops:
            raise NotAVideoError(f"{src} has no video frames")
        span = _span(shown, video.info.time_base, chosen)
        extras = read_extras(path, chosen.copied_kinds, span)
        pictures = (shot.rgb for shot in video)
        stills = list(still_shots(pictures, gops, steps)) if chosen.may_have_backgrounds else []
        empty = _begin(io.BytesIO(), video.info, chosen, extras)
        overhead = empty.final_size(len(gops) + len(stills), 0)
        planned = plan(
            gops,
            steps,
            size,
            chosen,
            seconds=duration,
            overhead=overhead,
            streams=extras.streams_bytes,
            stills=stills,
        )
        meter = Meter(gops, len(planned.backgrounds), parts, began, progress)
        meter.report()
        backgrounds = fit_backgrounds(planned.backgrounds, gops, chosen, parts, meter.report)
        missing = [gop for gop in gops if gop not in parts]
        workers, threads = processes_for(missing, size, chosen)
        waiting = tasks(video, gops, planned.gops, chosen, missing, workers, began, backgrounds)
        with closing(fit_gops(waiting, workers, threads)) as fitted:
            for done in fitted:
                _keep(done, parts)
                meter.report()
        with gathered_output(dst, overwrite=overwrite) as path:
            with path.open("w+b") as file:
                writer = _begin(file, video.info, chosen, extras)
                first_of_backgrounds = {gops[shot.gops.start] for shot, _ in planned.backgrounds}
                for gop in gops:
                    if gop in first_of_backgrounds:
                        writer.add_background(backgrounds[gop].payload)
                    writer.add_gop(parts.payload(gop))
                for stream in extras.streams:
                    writer.add_auxiliary(STREAMS_TYPE, stream.payload)
                writer.close()
            if verify:
                quality = {gop.start: parts.facts(gop)["psnr"] for gop in gops}
                verify_file(path, video, quality, threads)
        stats = _stats(gops, steps, writer, parts)
    frames = gops[-1].stop
    return EncodeResult(
        path=Path(dst),
        frames=frames,
        gops=len(gops),
        backgrounds=len(planned.backgrounds),
        gaussians=writer.gaussians,
        bytes=writer.size,
        bpp=8 * (writer.size - extras.streams_bytes) / (frames * size[0] * size[1]),
        psnr=sum(gop.psnr * gop.frames for gop in stats) / frames,
        float_psnr=sum(gop.float_psnr * gop.frames for gop in stats) / frames,
        seconds=time.perf_counter() - began,
        gop_stats=stats,
    )


def _analysis(
    video: VideoReader, settings: EncodeSettings, parts: Checkpoint
) -> tuple[list[FrameStats], tuple[int, int]]:
    """Every frame as `analyse` measures it, and from when to when all are shown, ticks."""
    kept = parts.analysis
    with suppress(TypeError, KeyError):  # what is not there, or of another shape, is made anew
        return [FrameStats(**step) for step in kept["steps"]], (kept["shown"][0], kept["shown"][1])
    shown = [0, 0]

    def pictures() -> Iterator[Rgb]:
        for number, frame in enumerate(video):
            shown[:] = shown[0] if number else frame.pts, frame.pts + frame.duration
            yield frame.rgb

    steps = list(analyse(pictures(), flow_estimator(settings.flow)))
    parts.keep_analysis({"shown": shown, "steps": [asdict(step) for step in steps]})
    return steps, (shown[0], shown[1])


def _span(shown: tuple[int, int], time_base: Fraction, settings: EncodeSettings) -> Span:
    """The time to keep of sound and subtitles: all of it at an end where no frame is cut off."""
    return Span(
        shown[0] * time_base
        if settings.start_frame or settings.start_seconds is not None
        else None,
        shown[1] * time_base if settings.frames or settings.stop_seconds is not None else None,
    )


def _begin(file: BinaryIO, info: VideoInfo, settings: EncodeSettings, extras: Extras) -> GsvrWriter:
    """Write all that comes before the first GOP."""
    header = Header(
        width=info.width,
        height=info.height,
        time_base=info.time_base,
        sample_aspect=info.sample_aspect,
        rotation=info.rotation,
        mirrored=info.mirrored,
        bit_depth=info.bit_depth,
        colour=info.colour,
    )
    writer = GsvrWriter(file, header)
    writer.add_auxiliary(SETTINGS_TYPE, json.dumps(settings.recorded()).encode())
    if extras.tags != Tags():
        writer.add_auxiliary(METADATA_TYPE, extras.tags.to_bytes())
    return writer


def _keep(done: FittedGop, parts: Checkpoint) -> None:
    """Put a finished GOP on the disk."""
    gop = done.gop
    facts = {"psnr": gop.psnr, "float_psnr": gop.float_psnr, "seconds": done.seconds}
    parts.add(done.frames, facts, gop.payload)


def _stats(
    gops: Sequence[range], steps: Sequence[FrameStats], writer: GsvrWriter, parts: Checkpoint
) -> tuple[GopStats, ...]:
    pixels = writer.header.width * writer.header.height
    return tuple(
        GopStats(
            first_frame=gop.start,
            frames=len(gop),
            cut=steps[gop.start].cut,
            motion=sum(step.motion for step in steps[gop.start : gop.stop]),
            gaussians=entry.gaussians,
            bytes=entry.chunk.size,
            bpp=8 * entry.chunk.size / (len(gop) * pixels),
            **parts.facts(gop),
        )
        for gop, entry in zip(gops, writer.gops, strict=True)
    )
