"""Jobs of an encode: their frames, budgets and time, and the processes that share them."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np

from gsvrcodec.bitstream.background_payload import unpack_background
from gsvrcodec.encoder.background import StaticRun
from gsvrcodec.encoder.budget import Budget
from gsvrcodec.encoder.checkpoint import Checkpoint
from gsvrcodec.encoder.jobs import BackgroundJob, GopJob, encode_gop
from gsvrcodec.encoder.plan import PlannedBackground
from gsvrcodec.encoder.settings import EncodeSettings
from gsvrcodec.encoder.tuned import BACKGROUND, PROCESSES
from gsvrcodec.encoder.workers import processes, starts
from gsvrcodec.errors import InputError
from gsvrcodec.fit.tuned import EFFORT
from gsvrcodec.limits import Limits
from gsvrcodec.model.background import Background
from gsvrcodec.video import SourceFrame, VideoInfo, VideoReader


@dataclass(frozen=True, slots=True, eq=False)
class FittedBackground:
    """A finished background."""

    background: Background
    payload: bytes  #: of its chunk
    run: StaticRun  #: the GOPs that may show it


def fit_backgrounds(
    planned: Sequence[PlannedBackground],
    gops: Sequence[range],
    settings: EncodeSettings,
    checkpoint: Checkpoint,
    report: Callable[[], None],
) -> dict[range, FittedBackground]:
    """Fit the backgrounds that `checkpoint` lacks, one after another.

    Args:
        planned: backgrounds to fit.
        gops: frames of all GOPs.
        settings: of the encode.
        checkpoint: keeps finished backgrounds.
        report: called after each.

    Returns:
        The background of each GOP that has one, by the frames of the GOP.
    """
    found: dict[range, FittedBackground] = {}
    for one in planned:
        run = one.run
        payload = checkpoint.background(run.number)
        if payload is None:
            frames = sum(len(gops[position]) for position in run.gops)
            seconds = None
            if settings.time_budget is not None:
                seconds = BACKGROUND.time_share * settings.time_budget * frames
            job = BackgroundJob(
                frames=run.picture[None],
                budget=one.budget,
                settings=settings,
                seconds=seconds,
                number=run.number,
                shown=frames,
            )
            payload = encode_gop(job).payload
            checkpoint.add_background(payload)
            report()
        fitted = FittedBackground(unpack_background(payload, Limits()), payload, run)
        found |= {gops[position]: fitted for position in run.gops}
    return found


def processes_for(
    gops: Sequence[range], size: tuple[int, int], settings: EncodeSettings
) -> tuple[int, int]:
    """Return the number of processes that fit these GOPs, and of their threads together."""
    frames, pixels = [len(gop) for gop in gops], size[0] * size[1]
    visits = EFFORT.frame_visits[settings.preset]
    pace = settings.time_budget or PROCESSES.step_seconds * visits * pixels
    return processes(
        # One process keeps a GPU busy.
        settings.workers or int(settings.device != "cpu"),
        settings.threads,
        gops=len(gops),
        gop_bytes=3 * pixels * max(frames, default=0),
        seconds=pace * sum(frames),
    )


def gop_jobs(
    video: VideoReader,
    gops: Sequence[range],
    budgets: Sequence[Budget],
    settings: EncodeSettings,
    missing: Sequence[range],
    workers: int,
    began: float,
    backgrounds: Mapping[range, FittedBackground],
) -> Iterator[GopJob]:
    """Yield the jobs of the `missing` GOPs; frames are read when a job is asked for.

    Args:
        video: the source.
        gops: frames of each GOP, in order.
        budgets: of each GOP.
        settings: of the encode; a time budget is shared out among the missing GOPs.
        missing: GOPs still to be fitted, in order.
        workers: how many are fitted at the same time.
        began: `time.perf_counter()` at the start of the encode.
        backgrounds: of the GOPs that have one.

    Raises:
        InputError: the video has become shorter.
    """
    turns, end = starts([len(gop) for gop in missing], workers)
    turn_of = dict(zip(missing, turns, strict=True))
    whole = sum(map(len, missing))
    frames = iter(video)
    for gop, budget in zip(gops, budgets, strict=True):
        if gop not in turn_of:
            deque(islice(frames, len(gop)), maxlen=0)
            continue
        seconds = None
        if settings.time_budget is not None:
            # A share of the time left, in proportion to its frames and the frames that wait for it.
            left = settings.time_budget * whole - (time.perf_counter() - began)
            seconds = max(0.0, left) * len(gop) / (end - turn_of[gop])
        own = islice(frames, len(gop))
        yield _gop_job(video.info, own, gop, budget, settings, seconds, backgrounds.get(gop))


def _gop_job(
    info: VideoInfo,
    source: Iterator[SourceFrame],
    gop: range,
    budget: Budget,
    settings: EncodeSettings,
    seconds: float | None,
    fitted: FittedBackground | None,
) -> GopJob:
    frames = np.empty((len(gop), info.height, info.width, 3), np.uint8)
    times = np.empty((2, len(gop)), np.int64)
    found = 0
    for found, frame in enumerate(source, 1):
        frames[found - 1] = frame.rgb
        times[:, found - 1] = frame.pts, frame.duration
    if found < len(gop):
        raise InputError(f"{info.path} became shorter while it was read")
    return GopJob(
        frames=frames,
        budget=budget,
        settings=settings,
        seconds=seconds,
        pts=times[0],
        durations=times[1],
        first_frame=gop.start,
        background=None if fitted is None else fitted.background,
        background_picture=None if fitted is None else fitted.run.picture,
    )
