"""A chain of GOPs as one task: all that a process anywhere needs, and the GOPs that come of it."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

from gsvrcodec.encoder.budget import Budget
from gsvrcodec.encoder.chain import ChainFrames, chain_jobs
from gsvrcodec.encoder.jobs import EncodedGop, GopJob, encode_gop
from gsvrcodec.encoder.settings import EncodeSettings
from gsvrcodec.errors import WorkerError
from gsvrcodec.versions import sources

#: Jobs of a chain: sent the result of one, it yields the next.
ChainJobs = Generator[GopJob, EncodedGop, None]


@dataclass(frozen=True, slots=True, eq=False)
class FittedGop:
    """A finished job and how long it took."""

    frames: range  #: numbers of its frames
    gop: EncodedGop
    seconds: float  #: wall time


@dataclass(frozen=True, slots=True, eq=False)
class ChainTask:
    """A chain to encode; can be pickled, and done once in each process that has it."""

    frames: ChainFrames
    budgets: Sequence[Budget]  #: of each GOP
    settings: EncodeSettings
    finished: Sequence[EncodedGop]  #: results of its first GOPs, which are not done again
    seconds: float | None  #: wall time for the others; None = by the preset
    sources: str = field(default_factory=sources)  #: digest of the code of the encoding process

    @property
    def first_frame(self) -> int:
        """Number of the first frame that is to be fitted."""
        return self.frames.gops[len(self.finished)].start

    def jobs(self) -> ChainJobs:
        """Yield the job of each GOP; is sent the result before it yields the next one."""
        return chain_jobs(self.frames, self.budgets, self.settings, self.finished, self.seconds)


def encode_chain(task: ChainTask, threads: int) -> list[FittedGop]:
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
    return list(one_by_one(task.jobs(), encode_gop, threads))


def one_by_one(
    chain: ChainJobs, encode: Callable[[GopJob], EncodedGop], threads: int
) -> Iterator[FittedGop]:
    """Encode the GOPs of a chain, one after another.

    Args:
        chain: its jobs; `threads` of their settings is replaced.
        encode: does one.
        threads: native threads.
    """
    job = next(chain, None)
    while job is not None:
        done = _fitted(encode, job, threads)
        job = None  # its frames are not needed any more
        yield done
        with suppress(StopIteration):
            job = chain.send(done.gop)


def _fitted(encode: Callable[[GopJob], EncodedGop], job: GopJob, threads: int) -> FittedGop:
    began = time.perf_counter()
    gop = encode(replace(job, settings=replace(job.settings, threads=threads)))
    frames = range(job.first_frame, job.first_frame + len(job.frames))
    return FittedGop(frames, gop, time.perf_counter() - began)
