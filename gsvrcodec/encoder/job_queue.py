"""Chains of an encode: their frames, budgets and time, and the processes that share them."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import chain as joined
from itertools import islice

from gsvrcodec.encoder.budget import Budget
from gsvrcodec.encoder.chain_reader import ChainReader
from gsvrcodec.encoder.chain_task import ChainTask
from gsvrcodec.encoder.checkpoint import Checkpoint
from gsvrcodec.encoder.lookahead import Lookahead, Section
from gsvrcodec.encoder.rate import frame_visits
from gsvrcodec.encoder.settings import EncodeSettings
from gsvrcodec.encoder.slicing import Chain
from gsvrcodec.encoder.tuned import PROCESSES
from gsvrcodec.encoder.workers import processes, starts
from gsvrcodec.render.native import resolve_threads
from gsvrcodec.video import VideoInfo
from gsvrcodec.video.timing import DEFAULT_RATE


def processes_for(
    lookahead: Lookahead, checkpoint: Checkpoint, info: VideoInfo, settings: EncodeSettings
) -> tuple[int, int]:
    """Return the number of processes that fit a film, and of their threads together.

    Waits until the analysis has found enough work for all of them, or the end of the film.
    """
    pixels = info.width * info.height
    pace = settings.time_budget or PROCESSES.step_seconds * frame_visits(settings) * pixels
    # One process keeps a GPU busy.
    wanted = settings.workers or int(settings.device != "cpu")
    most = max(wanted, resolve_threads(settings.threads))

    def missing(chains: Sequence[Chain]) -> list[Chain]:
        return [chain for chain in chains if missing_frames(chain, checkpoint)]

    def seconds(chains: Sequence[Chain]) -> float:
        return pace * sum(missing_frames(chain, checkpoint) for chain in chains)

    def enough(chains: Sequence[Chain]) -> bool:
        return seconds(chains) > PROCESSES.least_seconds and len(missing(chains)) >= most

    known = missing(lookahead.until(enough))
    frames = [chain[-1].stop - chain[0].start for chain in known]
    if not lookahead.complete and settings.predicts:
        frames.append(round(settings.keyint * (info.average_rate or DEFAULT_RATE)))
    return processes(
        wanted,
        settings.threads,
        chains=len(known),
        chain_bytes=3 * pixels * max(frames, default=0),
        gop_bytes=3 * pixels * max((len(gop) for chain in known for gop in chain), default=0),
        seconds=seconds(known),
    )


def missing_frames(chain: Chain, checkpoint: Checkpoint) -> int:
    """Return the frames of the GOPs of a chain that are not finished."""
    return sum(len(gop) for gop in chain[finished_gops(chain, checkpoint) :])


def finished_gops(chain: Chain, checkpoint: Checkpoint) -> int:
    """Return how many GOPs of a chain are finished, up to the first that is not."""
    return next((n for n, gop in enumerate(chain) if gop not in checkpoint), len(chain))


def all_tasks(
    sections: Iterable[Section],
    budgets_of: Callable[[Section], Sequence[Budget]],
    settings: EncodeSettings,
    checkpoint: Checkpoint,
    began: float,
    reader: ChainReader,
    workers: int,
) -> Iterator[ChainTask]:
    """Plan the first section, and return the chains with missing GOPs; frames are read as they go.

    Args:
        sections: of the film, in order.
        budgets_of: plans a section: a budget for each GOP.
        settings: of the encode; a time budget is shared out among the missing GOPs.
        checkpoint: has the finished GOPs.
        began: `time.perf_counter()` at the start of the encode.
        reader: of the frames.
        workers: how many chains are fitted at the same time.

    Raises:
        UsageError: the size asked for is too little; at once.
        InputError: the video has become shorter.
    """
    planned = ((section.chains, budgets_of(section)) for section in sections)
    first = list(islice(planned, 1))
    return (
        task
        for chains, budgets in joined(first, planned)
        for task in _tasks(chains, budgets, settings, checkpoint, began, reader, workers)
    )


def _tasks(
    chains: Sequence[Chain],
    budgets: Sequence[Budget],
    settings: EncodeSettings,
    checkpoint: Checkpoint,
    began: float,
    reader: ChainReader,
    workers: int,
) -> Iterator[ChainTask]:
    """Yield the tasks of a section."""
    missing = [missing_frames(chain, checkpoint) for chain in chains]
    turns, end = starts([count for count in missing if count], workers)
    turn_of = dict(zip((n for n, count in enumerate(missing) if count), turns, strict=True))
    waiting = iter(budgets)
    for number, chain in enumerate(chains):
        own = list(islice(waiting, len(chain)))
        if not missing[number]:
            reader.skip(chain)
            continue
        seconds = None
        if settings.time_budget is not None:
            # A share of the time left, in proportion to its frames and the frames that wait for it.
            left = settings.time_budget * sum(missing) - (time.perf_counter() - began)
            seconds = max(0.0, left) * missing[number] / (end - turn_of[number])
        done = [checkpoint.result(gop) for gop in chain[: finished_gops(chain, checkpoint)]]
        yield ChainTask(reader.read(chain, len(done)), own, settings, done, seconds)
