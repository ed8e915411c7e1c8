"""GOPs that wait for their fit: frames, bytes and seconds of each, and the processes they share."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import islice

import numpy as np

from gsvrcodec.bitstream.background_payload import unpack_background
from gsvrcodec.encoder.background import StillShot, still_rgb
from gsvrcodec.encoder.checkpoint import Checkpoint
from gsvrcodec.encoder.jobs import FRAME_VISITS, GopTask, background_task, encode_gop
from gsvrcodec.encoder.plan import Budget
from gsvrcodec.encoder.settings import EncodeSettings
from gsvrcodec.encoder.workers import processes, starts
from gsvrcodec.errors import InputError
from gsvrcodec.limits import Limits
from gsvrcodec.model.background import Background
from gsvrcodec.video import SourceFrame, VideoInfo, VideoReader

#: Roughly what a step of the fit takes for each pixel of its frame.
_VISIT_SECONDS = 15e-9
#: Part of the time of its GOPs that a background takes.
_BACKGROUND_TIME = 0.12


@dataclass(frozen=True, slots=True, eq=False)
class FittedBackground:
    """A background for the GOPs that may show it."""

    background: Background
    payload: bytes  #: of its chunk
    picture: bytes  #: what it was fitted to, a PNG file


def fit_backgrounds(
    backgrounds: Sequence[tuple[StillShot, Budget]],
    gops: Sequence[range],
    settings: EncodeSettings,
    parts: Checkpoint,
    report: Callable[[], None],
) -> dict[range, FittedBackground]:
    """Fit the backgrounds that are not in `parts`, one after another, and return that of each GOP.

    Args:
        backgrounds: shots that get one, and its budget.
        gops: frames of all GOPs.
        settings: of the encode.
        parts: keeps what is finished.
        report: called after each.
    """
    found: dict[range, FittedBackground] = {}
    for shot, budget in backgrounds:
        payload = parts.background(shot.number)
        if payload is None:
            frames = sum(len(gops[position]) for position in shot.gops)
            task = background_task(shot.number, still_rgb(shot.picture), frames, budget, settings)
            if settings.time_budget is not None:
                task = replace(task, seconds=_BACKGROUND_TIME * settings.time_budget * frames)
            payload = encode_gop(task).payload
            parts.add_background(payload)
            report()
        background = FittedBackground(unpack_background(payload, Limits()), payload, shot.picture)
        found |= {gops[position]: background for position in shot.gops}
    return found


def processes_for(
    gops: Sequence[range], size: tuple[int, int], settings: EncodeSettings
) -> tuple[int, int]:
    """Return how many processes, and threads of all of them, these GOPs are to be fitted with."""
    frames, pixels = [len(gop) for gop in gops], size[0] * size[1]
    pace = settings.time_budget or _VISIT_SECONDS * FRAME_VISITS[settings.preset] * pixels
    return processes(
        # One process keeps a GPU busy.
        settings.workers or int(settings.device != "cpu"),
        settings.threads,
        gops=len(gops),
        gop_bytes=3 * pixels * max(frames, default=0),
        seconds=pace * sum(frames),
    )


def tasks(
    video: VideoReader,
    gops: Sequence[range],
    budgets: Sequence[Budget],
    settings: EncodeSettings,
    missing: Sequence[range],
    workers: int,
    began: float,
    backgrounds: Mapping[range, FittedBackground],
) -> Iterator[GopTask]:
    """Yield the `missing` ones of the GOPs, read when they are asked for.

    Args:
        video: the source.
        gops: frames of each, in order.
        budgets: of each.
        settings: of the encode; a time budget is shared out among what is missing.
        missing: those still to be fitted, in order.
        workers: how many are fitted at the same time.
        began: when the encode began, `time.perf_counter()`.
        backgrounds: of the GOPs that have one.

    Raises:
        InputError: the video has become shorter.
    """
    turns, end = starts([len(gop) for gop in missing], workers)
    turn_of = dict(zip(missing, turns, strict=True))
    whole = sum(map(len, missing))
    shots = iter(video)
    for gop, budget in zip(gops, budgets, strict=True):
        if gop not in turn_of:
            deque(islice(shots, len(gop)), maxlen=0)
            continue
        seconds = None
        if settings.time_budget is not None:
            # A share of what is left, in proportion to its frames and those that wait for it.
            left = settings.time_budget * whole - (time.perf_counter() - began)
            seconds = max(0.0, left) * len(gop) / (end - turn_of[gop])
        task = _task(video.info, islice(shots, len(gop)), gop, budget, settings, seconds)
        if gop in backgrounds:
            task = replace(
                task,
                background=backgrounds[gop].background,
                background_picture=backgrounds[gop].picture,
            )
        yield task


def _task(
    info: VideoInfo,
    shots: Iterator[SourceFrame],
    gop: range,
    budget: Budget,
    settings: EncodeSettings,
    seconds: float | None,
) -> GopTask:
    frames = np.empty((len(gop), info.height, info.width, 3), np.uint8)
    times = np.empty((2, len(gop)), np.int64)
    found = 0
    for found, shot in enumerate(shots, 1):
        frames[found - 1] = shot.rgb
        times[:, found - 1] = shot.pts, shot.duration
    if found < len(gop):
        raise InputError(f"{info.path} became shorter while it was read")
    return GopTask(
        frames=frames,
        pts=times[0],
        durations=times[1],
        first_frame=gop.start,
        settings=settings,
        seconds=seconds,
        **asdict(budget),
    )
