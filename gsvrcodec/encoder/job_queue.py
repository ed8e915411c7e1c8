"""Chains of an encode: their frames, budgets and time, and the processes that share them."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator, Sequence
from itertools import islice

import numpy as np

from gsvrcodec.encoder.budget import Budget
from gsvrcodec.encoder.chain import ChainFrames
from gsvrcodec.encoder.chain_task import ChainTask
from gsvrcodec.encoder.checkpoint import Checkpoint
from gsvrcodec.encoder.packed import packed
from gsvrcodec.encoder.rate import frame_visits
from gsvrcodec.encoder.settings import EncodeSettings
from gsvrcodec.encoder.slicing import Chain
from gsvrcodec.encoder.tuned import PROCESSES
from gsvrcodec.encoder.workers import processes, starts
from gsvrcodec.errors import InputError
from gsvrcodec.video import SourceFrame, VideoInfo, VideoReader


def processes_for(
    chains: Sequence[Chain], size: tuple[int, int], settings: EncodeSettings
) -> tuple[int, int]:
    """Return the number of processes that fit these chains, and of their threads together."""
    frames, pixels = [sum(map(len, chain)) for chain in chains], size[0] * size[1]
    pace = settings.time_budget or PROCESSES.step_seconds * frame_visits(settings) * pixels
    return processes(
        # One process keeps a GPU busy.
        settings.workers or int(settings.device != "cpu"),
        settings.threads,
        chains=len(chains),
        chain_bytes=3 * pixels * max(frames, default=0),
        gop_bytes=3 * pixels * max((len(gop) for chain in chains for gop in chain), default=0),
        seconds=pace * sum(frames),
    )


def missing_frames(chain: Chain, checkpoint: Checkpoint) -> int:
    """Return the frames of the GOPs of a chain that are not finished."""
    return sum(len(gop) for gop in chain[finished_gops(chain, checkpoint) :])


def finished_gops(chain: Chain, checkpoint: Checkpoint) -> int:
    """Return how many GOPs of a chain are finished, up to the first that is not."""
    return next((n for n, gop in enumerate(chain) if gop not in checkpoint), len(chain))


def all_tasks(
    video: VideoReader,
    chains: Sequence[Chain],
    budgets: Sequence[Budget],
    settings: EncodeSettings,
    checkpoint: Checkpoint,
    workers: int,
    began: float,
    *,
    pack: bool = False,
) -> Iterator[ChainTask]:
    """Yield each chain with missing GOPs; its frames are read when it is asked for.

    Args:
        video: the source.
        chains: frames of each GOP, in order.
        budgets: of each GOP.
        settings: of the encode; a time budget is shared out among the missing GOPs.
        checkpoint: has the finished GOPs.
        workers: how many chains are fitted at the same time.
        began: `time.perf_counter()` at the start of the encode.
        pack: pack the pictures of each GOP as soon as they are read.

    Raises:
        InputError: the video has become shorter.
    """
    missing = [missing_frames(chain, checkpoint) for chain in chains]
    turns, end = starts([count for count in missing if count], workers)
    turn_of = dict(zip((n for n, count in enumerate(missing) if count), turns, strict=True))
    frames, waiting = iter(video), iter(budgets)
    for number, chain in enumerate(chains):
        own = list(islice(waiting, len(chain)))
        if not missing[number]:
            deque(islice(frames, chain[-1].stop - chain[0].start), maxlen=0)
            continue
        seconds = None
        if settings.time_budget is not None:
            # A share of the time left, in proportion to its frames and the frames that wait for it.
            left = settings.time_budget * sum(missing) - (time.perf_counter() - began)
            seconds = max(0.0, left) * missing[number] / (end - turn_of[number])
        done = [checkpoint.result(gop) for gop in chain[: finished_gops(chain, checkpoint)]]
        pictures = _read(video.info, frames, chain, len(done), pack=pack)
        yield ChainTask(pictures, own, settings, done, seconds)


def _read(
    info: VideoInfo, source: Iterator[SourceFrame], chain: Chain, finished: int, *, pack: bool
) -> ChainFrames:
    """Read the frames of a chain; the pictures of finished GOPs are skipped."""
    read = ChainFrames(chain, [], [], [])
    for number, gop in enumerate(chain):
        kept = len(gop) if number >= finished else 0
        pictures = np.empty((kept, info.height, info.width, 3), np.uint8)
        times = np.empty((2, len(gop)), np.int64)
        found = 0
        for found, frame in enumerate(islice(source, len(gop)), 1):
            times[:, found - 1] = frame.pts, frame.duration
            if kept:
                pictures[found - 1] = frame.rgb
        if found < len(gop):
            raise InputError(f"{info.path} became shorter while it was read")
        read.pictures.append(packed(pictures) if pack else pictures)
        read.pts.append(times[0])
        read.durations.append(times[1])
    return read
