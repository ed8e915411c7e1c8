"""Chains of GOPs: each GOP but the first is predicted from the one before, as a decoder has it."""

from __future__ import annotations

import heapq
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import accumulate, islice, repeat
from itertools import chain as joined

from gsvrcodec.bitstream.gop_payload import coded_plate, unpack_gop, unpack_plate
from gsvrcodec.encoder.checkpoint import Checkpoint
from gsvrcodec.encoder.film import Chain, Section
from gsvrcodec.encoder.gop import encode_gop
from gsvrcodec.encoder.job import GopJob, Reference
from gsvrcodec.encoder.plan import Budget
from gsvrcodec.encoder.plates import Ground, grounds
from gsvrcodec.encoder.rate import visited_frames
from gsvrcodec.encoder.results import EncodedGop
from gsvrcodec.encoder.settings import EncodeSettings
from gsvrcodec.encoder.size import Rooms, Spending
from gsvrcodec.encoder.source import ChainFrames, ChainReader
from gsvrcodec.errors import WorkerError
from gsvrcodec.fit.footage import Picture
from gsvrcodec.fit.target import Size, Slope
from gsvrcodec.limits import Limits
from gsvrcodec.versions import sources


def chain_jobs(
    chain: ChainFrames,
    budgets: Sequence[Budget],
    settings: EncodeSettings,
    finished: Sequence[EncodedGop],
    seconds: float | None,
    plate: bytes | None = None,
    room: float | None = None,
) -> Generator[GopJob, EncodedGop, None]:
    """Yield the job of each GOP; is sent the result before it yields the next one.

    Args:
        chain: the frames; of finished GOPs, those of the last alone are needed.
        budgets: of each GOP.
        settings: of the encode.
        finished: results of the first GOPs of the chain, which are not done again.
        seconds: wall time for the GOPs that are not finished; None = by the preset.
        plate: of the chain, coded; None = it has none.
        room: bytes that it may take, but for the plate; None = any.
    """
    began = time.perf_counter()
    spending = None if room is None else Spending([budget.bytes for budget in budgets], room)
    state = _State(settings, plate, spending)
    before: Picture | None = None  #: last frame of the GOP before
    given = overrun = 0.0  # seconds that GOPs had, and took beyond them: to read, start, pack
    for number, (gop, budget) in enumerate(zip(chain.gops, budgets, strict=True)):
        if number < len(finished):
            state.add(finished[number])
            if number + 1 == len(finished):
                before = chain.take(number)[-1].copy()
            continue
        asked = time.perf_counter()
        frames = chain.take(number)
        left = None
        if seconds is not None:
            waiting = [
                visited_frames(len(own)) * planned.step_cost
                for own, planned in zip(chain.gops, budgets, strict=True)
            ][number:]
            kept = given / (given + overrun) if given else 1.0
            spent = time.perf_counter() - began
            left = kept * max(0.0, seconds - spent) * waiting[0] / sum(waiting)
        job = GopJob(
            frames=frames,
            pts=chain.pts[number],
            durations=chain.durations[number],
            first_frame=gop.start,
            budget=state.budget(budget),
            settings=settings,
            execution=settings.execution,
            seconds=left,
            reference=state.reference,
            before=before,
            plate=state.plate,
            alone=len(chain.gops) == 1,
        )
        before = frames[-1].copy()  # without the others
        del frames
        result = yield job
        del job
        if left is not None:
            given += left
            overrun += max(0.0, time.perf_counter() - asked - left)
        if number + 1 < len(chain.gops):
            state.add(result)


class _State:
    """Last GOP of a chain as a decoder has it, and bytes that are left."""

    def __init__(
        self, settings: EncodeSettings, plate: bytes | None, spending: Spending | None
    ) -> None:
        self._settings = settings
        self._of_chain, self._spending = plate, spending
        self.reference: Reference | None = None  #: of the next GOP
        self.plate = plate  #: for the next key GOP, coded; None = none is known

    def add(self, result: EncodedGop) -> None:
        """Count a finished GOP, and take it for the reference of the next one."""
        if self._spending is not None:
            coded = coded_plate(result.payload)
            beside = 0 if coded is None or coded != self._of_chain else len(coded)
            self._spending.add(len(result.payload) - beside)
        if not self._settings.predicts or result.qscale is None:
            return
        content = unpack_gop(result.payload, None, Limits())
        before = self.reference
        whole, plate = content.new, None
        if content.plate is not None:
            self.plate, plate = content.plate, unpack_plate(content.plate)
        if before is not None and content.carried is not None:
            whole, plate = content.gop(before.gop, before.frames), before.plate
        self.reference = Reference(
            whole, result.frames.start, len(result.frames), result.qscale, result.psnr, plate
        )

    def budget(self, planned: Budget) -> Budget:
        """Return a GOP's budget, by what is left."""
        spending, slope = self._spending, planned.target
        if spending is None or not isinstance(slope, Slope):
            return planned
        slope = replace(slope, qscale=spending.coarser() * slope.qscale)
        exact = Size(max(1, int(spending.left)), slope)
        return replace(planned, target=exact if spending.is_last else slope)


#: Jobs of a chain: sent the result of one, it yields the next.
ChainJobs = Generator[GopJob, EncodedGop, None]


@dataclass(frozen=True, slots=True, eq=False)
class ChainTask:
    """A chain to encode; can be pickled, and done once in each process that has it."""

    frames: ChainFrames
    budgets: Sequence[Budget]  #: of each GOP
    settings: EncodeSettings
    finished: Sequence[EncodedGop]  #: results of its first GOPs, which are not done again
    seconds: float | None  #: wall time for the others; None = by the preset
    plate: bytes | None = None  #: of the chain, coded; None = it has none
    room: float | None = None  #: bytes that it may take, but for the plate; None = any
    sources: str = field(default_factory=sources)  #: digest of the code of the encoding process

    @property
    def first_frame(self) -> int:
        """Number of the first frame that is to be fitted."""
        return self.frames.gops[len(self.finished)].start

    def jobs(self) -> ChainJobs:
        """Yield the job of each GOP; is sent the result before it yields the next one."""
        return chain_jobs(
            self.frames,
            self.budgets,
            self.settings,
            self.finished,
            self.seconds,
            self.plate,
            self.room,
        )


def encode_chain(task: ChainTask, threads: int) -> list[EncodedGop]:
    """Encode the missing GOPs of a chain in this process.

    The same task gives the same bytes in any process and any order, unless it is timed.

    Args:
        task: the chain.
        threads: native threads; 0 = GSVR_THREADS or all cores.

    Raises:
        WorkerError: this process has another version of the package than the one of the task.
    """
    if task.sources != sources():
        raise WorkerError(
            f"a worker has other sources of gsvrcodec ({sources()}) than the process that encodes "
            f"({task.sources}): install the same version on both"
        )
    return list(one_by_one(task.jobs(), encode_gop, lambda: threads))


def one_by_one(
    chain: ChainJobs, encode: Callable[[GopJob], EncodedGop], threads: Callable[[], int]
) -> Iterator[EncodedGop]:
    """Encode the GOPs of a chain, one after another.

    Args:
        chain: its jobs; `threads` of their execution is replaced.
        encode: does one.
        threads: native threads for the next one.
    """
    job = next(chain, None)
    while job is not None:
        done = encode(replace(job, execution=replace(job.execution, threads=threads())))
        job = None  # its frames are not needed any more
        yield done
        with suppress(StopIteration):
            job = chain.send(done)


def starts(lengths: Sequence[int], workers: int) -> tuple[list[int], int]:
    """Return when each task starts and when the last one ends, if time goes by frames.

    Args:
        lengths: frames of each; 0 = it is none.
        workers: how many tasks are done at the same time.
    """
    free = [0] * workers
    out = []
    for length in filter(None, lengths):
        out.append(free[0])
        heapq.heapreplace(free, free[0] + length)
    return out, max(free)


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

    def missing(parts: Iterable[Chain]) -> list[int]:
        return [missing_frames(part, checkpoint) for part in parts]

    begun: list[int] = []  # frames of each task so far
    to_do = missing(chains)
    turns, end = starts(to_do, workers)
    looks = settings.plates and any(to_do)
    rooms, before = Rooms(sum(budget.bytes for budget in budgets)), None
    waiting = iter(budgets)
    found = _grounds(chains, budgets, settings, reader) if looks else repeat(Ground())
    for number, (chain, ground) in enumerate(zip(chains, found, strict=False), 1):
        parts = ground.parts(chain) if settings.structure.parted else [chain]
        lengths, plate = missing(parts), ground.plate
        if len(parts) > 1:
            turns, end = starts([*begun, *lengths, *to_do[number:]], workers)
        for part, frames in zip(parts, lengths, strict=True):
            own = list(islice(waiting, len(part)))
            room = rooms.of_chain(own, 0 if plate is None or plate is before else len(plate))
            before = plate
            if not frames:
                continue
            seconds = None
            if settings.time_budget is not None:
                # A share of the time left, in proportion to its frames and those that wait for it.
                left = settings.time_budget * sum(to_do) - (time.perf_counter() - began)
                seconds = max(0.0, left) * frames / (end - turns[len(begun)])
            begun.append(frames)
            done = [checkpoint.result(gop) for gop in part[: finished_gops(part, checkpoint)]]
            read = reader.read(part, len(done))
            yield ChainTask(read, own, settings, done, seconds, plate, room)


def _grounds(
    chains: Sequence[Chain],
    budgets: Sequence[Budget],
    settings: EncodeSettings,
    reader: ChainReader,
) -> Iterator[Ground]:
    """Yield what stands still in each chain of a section."""
    heads = accumulate(map(len, chains[:-1]), initial=0)
    slopes = [budgets[head].slope for head in heads]
    read, seconds = reader.ahead.read, settings.time_budget
    return grounds(chains, slopes, read, share=settings.predicts, frame_seconds=seconds)
