"""The encoder in one page: read, analyse, slice, plan, fit each GOP, write."""

from __future__ import annotations

import io
import json
import logging
import os
import time
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import replace
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import BinaryIO, Unpack

from gsvrcodec.bitstream.chunk import METADATA_TYPE, SETTINGS_TYPE, STREAMS_TYPE
from gsvrcodec.bitstream.gop_head import GopEntry
from gsvrcodec.bitstream.header import IMAGE_CODECS_FLAG, PLATES_FLAG, Header
from gsvrcodec.bitstream.plane_entries import IMAGE_CODECS
from gsvrcodec.bitstream.tags import Tags
from gsvrcodec.bitstream.writer import GsvrWriter
from gsvrcodec.encoder.checkpoint import Checkpoint
from gsvrcodec.encoder.film_target import Aim, FilmSize, MeanPsnr
from gsvrcodec.encoder.first_pass import Plan, PsnrGoal, SizeGoal, Sizes, first_pass
from gsvrcodec.encoder.lookahead import Lookahead
from gsvrcodec.encoder.output import Destination, open_output, verify_file
from gsvrcodec.encoder.passes import Passes
from gsvrcodec.encoder.progress import Meter, Progress
from gsvrcodec.encoder.request import Request, checked
from gsvrcodec.encoder.results import EncodedGop, EncodeResult, GopStats
from gsvrcodec.encoder.run import Runner
from gsvrcodec.encoder.run.executor import OnExecutor
from gsvrcodec.encoder.run.local import Processes
from gsvrcodec.encoder.settings import EncodeOptions, EncodeSettings
from gsvrcodec.encoder.source import ChainReader, ReadHere, ReadThere
from gsvrcodec.errors import NotAVideoError
from gsvrcodec.planes import PACKS
from gsvrcodec.render.device import choose_device
from gsvrcodec.versions import versions
from gsvrcodec.video import (
    Extras,
    Span,
    VideoInfo,
    VideoReader,
    VideoSource,
    open_video,
    read_extras,
    rereadable,
)

__all__ = ["EncodeResult", "GopStats", "Progress", "encode"]

#: Part of the bits asked for that a file may leave without a word.
_LEFT = 0.03
#: dB by which a film may be coarser than asked for without a word.
_MISSED = 0.5

_log = logging.getLogger(__name__)


def encode(
    src: VideoSource,
    dst: str | os.PathLike[str] | BinaryIO | None = None,
    *,
    fps: float | Fraction | str | None = None,
    overwrite: bool = False,
    resume: bool = False,
    verify: bool = False,
    progress: Callable[[Progress], None] | None = None,
    executor: Executor | None = None,
    shared_source: bool = False,
    **settings: Unpack[EncodeOptions],
) -> EncodeResult:
    """Encode a video file, or frames from memory, as a .gsvr file.

    The source is read twice, frame by frame: to analyse its motion, and to fit it; where a size or
    a PSNR is to be met, once or twice more, to fit it quickly. Some frames are read once more, for
    plates. What can be read only once, and frames from memory, wait in a temporary file. A file
    `dst` appears when it is whole; until then finished GOPs are kept in `dst` + ".part".

    Args:
        src: what to encode, one of
            * any video that FFmpeg reads, by its path, as bytes or as a binary file object;
              numbered pictures such as in_%04d.png; or "-" = the standard input;
            * frames as a NumPy array or a torch tensor (F, H, W, 3) on any device, or as an
              iterable of (H, W, 3): RGB, uint8, or floating-point numbers from 0 to 1, which are
              rounded to 8 bits. They are fitted as they are, without a conversion to YCbCr;
            * an input container of PyAV, over a file or a file object: its file, from the start.
        dst: path of the .gsvr file, "-" = the standard output; a binary file object, which stays
            open, is written when the file is whole, or GOP by GOP if it cannot seek; None = the
            bytes are `data` of the result.
        fps: frames a second, for frames from memory; a string may be a fraction, "30000/1001".
        overwrite: replace `dst` if it exists, and the checkpoint of an interrupted encode.
        resume: go on from the checkpoint of an interrupted encode, if there is one; the file will
            be the same as without interruption, unless there is a time budget.
        verify: read the source once more, and compare the file with it.
        progress: called at once, about twice a second while the film is analysed and nothing else
            can go on, when the fits begin, after each GOP, and before the file is verified; in a
            first pass, too.
        executor: any `concurrent.futures.Executor`, such as `gsvrcodec.Cluster`, whose workers fit
            whole chains of GOPs; None = processes of this machine. It stays open. The bytes are
            the same, on the same kind of machine. `workers` is then how many chains it does at
            the same time, by default as many as it has workers; `threads` is of each chain, and
            `device="auto"` is resolved by each worker.
        shared_source: the workers of the `executor` read `src` by themselves: all of them see the
            file at the same absolute path. Each picture that they read is compared with the
            checksum of the one that was analysed here. False = frames are sent to them.
        **settings: fields of `EncodeSettings`.

    Returns:
        Size, quality and time of the whole and of each GOP; with `dst=None` the file, too.

    Raises:
        DeviceError: the GPU that was asked for is not usable, or its memory does not suffice.
        UsageError: settings contradict each other or do not fit the video; frames from memory
            have another shape, type or range, change in size, or come without `fps`.
        InputError: `src` cannot be read.
        NotAVideoError: `src` has no video, or there are no frames.
        OutputError: `dst` cannot be written, or the checkpoint does not fit.
        WorkerError: a process died.
        ClusterError: the cluster of the `executor` was lost.
        VerificationError: the file does not decode to the source.
    """
    began = time.perf_counter()
    chosen = EncodeSettings.of(settings)
    elsewhere = None
    if executor is None:
        chosen = replace(chosen, device=choose_device(chosen.device))
    else:
        elsewhere = OnExecutor(executor, chosen.workers, chosen.threads)
    request = checked(
        src,
        dst,
        chosen,
        overwrite=overwrite,
        resume=resume,
        executor=executor is not None,
        shared_source=shared_source,
    )
    begun_with = {"versions": versions(), **request.source, "settings": chosen.recorded()}
    with (
        rereadable(src, fps=fps, part=chosen.part) as path,
        open_video(path, **request.reading) as video,
        Checkpoint(request.beside, begun_with, resume=resume, restart=overwrite) as checkpoint,
        Lookahead(video, chosen, checkpoint, checksums=shared_source) as lookahead,
    ):
        size = video.info.width, video.info.height
        pace, tick = partial(chosen.expected_pace, size[0] * size[1]), video.info.time_base
        meter_of = partial(
            Meter,
            lookahead,
            progress=progress,
            time_base=tick,
            expected=video.expected_frames,
            pace=pace,
        )
        meter = meter_of(checkpoint, began)
        lookahead.waiting = partial(meter.report, "analysing")
        lookahead.waiting()
        # Analyse, ahead of the fits: where GOPs begin, and which are predicted.
        if not lookahead.until(bool):
            raise NotAVideoError(f"{path} has no video frames")
        extras = read_extras(path, chosen.copied_kinds, _span(lookahead, video.info, chosen))
        begin = partial(_begin, info=video.info, settings=chosen, extras=extras)
        runner: Runner = elsewhere or Processes.for_film(lookahead, checkpoint, video.info, chosen)
        reader: Callable[[], ChainReader] = partial(ReadHere, video, lookahead, pack=runner.sends)
        if shared_source:
            reader = partial(ReadThere, video, request.reading, lookahead)
        passes = Passes(lookahead, size, reader, runner, meter_of)

        # A size or a PSNR is met by a constant quality, which first passes find.
        made, aims = chosen, None
        if isinstance(chosen.target, Aim):
            aims = checkpoint.first_pass
            if aims is None:
                aims = _aims(chosen, chosen.target, passes, begin, extras)
                checkpoint.keep_first_pass(aims)
            made = chosen.at_quality(aims.crf)
            meter = meter_of(checkpoint, time.perf_counter())

        # Plan each section, and fit: chains side by side, the GOPs of each one after another.
        check = partial(_check, video, meter, checkpoint, chosen.threads)
        destination = Destination(
            target=request.target,
            overwrite=overwrite,
            begin=begin,
            gops=lookahead.gops,
            checkpoint=checkpoint,
            check=check if verify else None,
            predicts=chosen.predicts,
        )
        meter.workers, lookahead.waiting = runner.at_once, meter.report
        meter.report()
        with open_output(destination) as output:
            for _ in passes.fitted(made, checkpoint, began, aims):
                output.write_finished()
                meter.report()
            writer = output.finish()
        gop_stats = _gop_stats(lookahead, writer, checkpoint)
    seconds = float(sum(lookahead.durations) * video.info.time_base)
    result = _result(request, gop_stats, writer, extras.streams_bytes, seconds, began)
    if isinstance(aims, Sizes):
        _warn_of_size(sum(gop.bytes for gop in gop_stats), aims.total)
    elif isinstance(chosen.target, MeanPsnr):
        _warn_of_psnr(result.psnr, chosen.target.decibels)
    return result


def _span(lookahead: Lookahead, info: VideoInfo, settings: EncodeSettings) -> Span:
    """The time to keep of sound and subtitles: all of it at an end where no frame is cut off.

    A cut-off end has to be analysed first.
    """
    start = stop = None
    if settings.start_frame or settings.start_seconds is not None:
        start = lookahead.pts[0] * info.time_base
    if settings.frames or settings.stop_seconds is not None:
        stop = lookahead.end() * info.time_base
    return Span(start, stop)


def _aims(
    settings: EncodeSettings,
    target: Aim,
    passes: Passes,
    begin: Callable[..., GsvrWriter],
    extras: Extras,
) -> Plan:
    """Return what each GOP is to take or to reach, and the quality of that, by first passes."""
    known, measure = passes.lookahead, passes.measured
    seconds = sum(section.seconds for section in known.sections())
    guess = target.guess(known.stats, passes.size, seconds).crf
    if isinstance(target, FilmSize):
        empty = begin(io.BytesIO(), stream=False, extras=replace(extras, streams=()))
        room = target.room(
            passes.size,
            len(known.stats),
            len(known.gops),
            seconds=seconds,
            overhead=empty.final_size(len(extras.streams) + len(known.gops), 0),
            streams=extras.streams_bytes,
        )
        return first_pass(settings, guess, SizeGoal(room), measure)
    assert isinstance(target, MeanPsnr)
    frames = tuple(map(len, known.gops))
    return first_pass(settings, guess, PsnrGoal(target.decibels, frames), measure)


def _begin(
    file: BinaryIO, *, stream: bool, info: VideoInfo, settings: EncodeSettings, extras: Extras
) -> GsvrWriter:
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
        blending=settings.blending,
        flags_required=PLATES_FLAG * settings.has_plates,
        flags_optional=IMAGE_CODECS_FLAG * (not IMAGE_CODECS.isdisjoint(PACKS[settings.pack])),
    )
    writer = GsvrWriter(file, header, stream=stream)
    writer.add_auxiliary(SETTINGS_TYPE, json.dumps(settings.recorded()).encode())
    if extras.tags != Tags():
        writer.add_auxiliary(METADATA_TYPE, extras.tags.to_bytes())
    for copied in extras.streams:
        writer.add_auxiliary(STREAMS_TYPE, copied.payload)
    return writer


def _check(
    video: VideoReader, meter: Meter, checkpoint: Checkpoint, threads: int, path: Path
) -> None:
    """Compare a file with its source, and with the quality that was measured."""
    meter.report("verifying")
    quality = {own.start: checkpoint.figures(own).psnr for own in checkpoint}
    verify_file(path, video, quality, threads)


def _warn_of_size(taken: int, wanted: int) -> None:
    """Say so if the GOPs of a file take fewer bytes than they were to, or more."""
    if taken > wanted:
        _log.warning(
            "the file takes %.1f %% more than asked for: its GOPs take no less; use longer GOPs "
            "or a smaller picture",
            100 * (taken / wanted - 1),
        )
    if taken < (1 - _LEFT) * wanted:
        _log.warning(
            "the file takes %.0f %% of the bits asked for: more would win next to nothing at this "
            "effort; a slower preset or more time would use them",
            100 * taken / wanted,
        )


def _warn_of_psnr(reached: float, wanted: float) -> None:
    """Say so if a film is coarser than it was to be."""
    if reached < wanted - _MISSED:
        _log.warning(
            "the film has %.1f dB where %g were asked for: more would win next to nothing at this "
            "effort; a slower preset or more time would come nearer",
            reached,
            wanted,
        )


def _result(
    request: Request,
    gop_stats: tuple[GopStats, ...],
    writer: GsvrWriter,
    streams_bytes: int,
    duration: float,
    began: float,
) -> EncodeResult:
    target, frames = request.target, sum(gop.frames for gop in gop_stats)
    pixels = frames * writer.header.width * writer.header.height
    return EncodeResult(
        path=target if isinstance(target, Path) else None,
        frames=frames,
        gops=len(gop_stats),
        key_gops=sum(gop.key for gop in gop_stats),
        gaussians=writer.gaussians,
        bytes=writer.size,
        bpp=8 * (writer.size - streams_bytes) / pixels,
        bitrate=8 * (writer.size - streams_bytes) / duration if duration else 0.0,
        psnr=sum(gop.psnr * gop.frames for gop in gop_stats) / frames,
        float_psnr=sum(gop.float_psnr * gop.frames for gop in gop_stats) / frames,
        seconds=time.perf_counter() - began,
        gop_stats=gop_stats,
        data=target.getvalue() if request.in_memory and isinstance(target, io.BytesIO) else None,
    )


def _gop_stats(
    lookahead: Lookahead,
    writer: GsvrWriter,
    checkpoint: Checkpoint,
) -> tuple[GopStats, ...]:
    pixels = writer.header.width * writer.header.height

    def stats_of(own: EncodedGop, entry: GopEntry) -> GopStats:
        analysed = lookahead.stats[own.frames.start : own.frames.stop]
        return GopStats(
            first_frame=own.frames.start,
            frames=len(own.frames),
            cut=analysed[0].cut,
            key=entry.is_key,
            motion=sum(frame.motion for frame in analysed),
            gaussians=entry.gaussians,
            bytes=entry.chunk.size,
            bpp=8 * entry.chunk.size / (len(own.frames) * pixels),
            psnr=own.psnr,
            float_psnr=own.float_psnr,
            seconds=own.seconds,
            qscale=own.qscale,
        )

    return tuple(map(stats_of, map(checkpoint.figures, lookahead.gops), writer.gops))
