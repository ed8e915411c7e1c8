"""Chains fitted side by side, each in a process of its own, or one after another in this one."""

from __future__ import annotations

import os
import pickle
import queue
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Generator, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import Self

from gsvrcodec.encoder.chain import ChainJobs, ChainTask, missing_frames, one_by_one
from gsvrcodec.encoder.checkpoint import Checkpoint
from gsvrcodec.encoder.film import Chain
from gsvrcodec.encoder.gop import encode_gop
from gsvrcodec.encoder.job import GopJob
from gsvrcodec.encoder.lookahead import Lookahead
from gsvrcodec.encoder.results import EncodedGop
from gsvrcodec.encoder.settings import EncodeSettings, Execution
from gsvrcodec.encoder.tuned import PROCESSES
from gsvrcodec.errors import WorkerError
from gsvrcodec.render.native import resolve_threads
from gsvrcodec.video import VideoInfo


@dataclass(frozen=True, slots=True)
class Processes:
    """Does tasks in processes of this machine; a `Runner`."""

    workers: int  #: processes; 1 = this one
    threads: int  #: native threads of all of them together
    sends: bool = False  #: tasks stay on this machine

    @classmethod
    def for_film(
        cls,
        lookahead: Lookahead,
        checkpoint: Checkpoint,
        info: VideoInfo,
        settings: EncodeSettings,
    ) -> Self:
        """Return as many as have work; waits until the analysis knows of enough, or of the end."""
        pixels = info.width * info.height
        pace = settings.expected_pace(pixels)
        execution = settings.execution
        wanted, most = _wanted(execution)

        def missing(chains: Sequence[Chain]) -> list[Chain]:
            return [chain for chain in chains if missing_frames(chain, checkpoint)]

        def seconds(chains: Sequence[Chain]) -> float:
            return pace * sum(missing_frames(chain, checkpoint) for chain in chains)

        def tasks(chains: Sequence[Chain]) -> int:
            """Most that can be done at the same time: all GOPs, where they may have a plate."""
            parted = settings.plates and settings.structure.parted
            return sum(len(chain) if parted else 1 for chain in missing(chains))

        def enough(chains: Sequence[Chain]) -> bool:
            return seconds(chains) > PROCESSES.least_seconds and tasks(chains) >= most

        known = missing(lookahead.until(enough))
        longest = max((len(gop) for chain in known for gop in chain), default=0)
        workers, threads = processes(
            wanted,
            execution.threads,
            tasks=tasks(known),
            gop_bytes=3 * pixels * longest,
            seconds=seconds(known),
        )
        return cls(workers, threads)

    def at_once(self) -> int:
        """Return how many tasks are done at the same time."""
        return self.workers

    def run(self, tasks: Iterator[ChainTask]) -> Generator[EncodedGop, None, None]:
        """Do all tasks; as `fit_gops`."""
        return fit_gops((task.jobs() for task in tasks), self.workers, self.threads)


def _wanted(execution: Execution) -> tuple[int, int]:
    """Return how many processes are asked for, 0 = by time and memory, and how many may be."""
    # One process keeps a GPU busy.
    wanted = execution.workers or int(execution.device != "cpu")
    return wanted, max(wanted, resolve_threads(execution.threads))


def fit_gops(
    chains: Iterable[ChainJobs], workers: int, threads: int
) -> Generator[EncodedGop, None, None]:
    """Encode GOPs and yield each as soon as it is done; the bytes do not depend on `workers`.

    A chain is taken when a worker is free, so that at most `workers` chains are in memory. The
    last ones share all threads. Closing the generator kills the processes.

    Args:
        chains: jobs, each of which may need the result of the one before; `threads` of their
            execution is replaced.
        workers: processes to fit in; 1 = this one.
        threads: native threads of all workers together.

    Raises:
        WorkerError: a process died, as it does when memory runs out.
        Exception: whatever `encode_gop` raises.
    """
    if workers == 1:
        for chain in chains:
            yield from one_by_one(chain, encode_gop, lambda: threads)
        return
    with ExitStack() as stack:
        # Unwound from below: workers die first, which ends the threads that wait for them.
        pool = stack.enter_context(ThreadPoolExecutor(workers))
        idle: queue.SimpleQueue[tuple[_Worker, int]] = queue.SimpleQueue()
        for number in range(workers):
            idle.put((stack.enter_context(_Worker()), number))

        finished: queue.SimpleQueue[EncodedGop | BaseException | None] = queue.SimpleQueue()
        sharing = workers  # chains that share the threads

        def fit(chain: ChainJobs) -> None:
            worker, number = idle.get()

            def share() -> int:
                return max(1, threads // sharing + (number % sharing < threads % sharing))

            try:
                for done in one_by_one(chain, worker, share):
                    finished.put(done)
                finished.put(None)
            except BaseException as error:
                finished.put(error)
            finally:
                idle.put((worker, number))

        running = 0
        for chain in chains:
            pool.submit(fit, chain)
            running += 1
            while running == workers:
                running -= yield from _next(finished)
        while running:
            sharing = running
            running -= yield from _next(finished)


def _next(
    finished: queue.SimpleQueue[EncodedGop | BaseException | None],
) -> Generator[EncodedGop, None, int]:
    """Yield the next GOP; or return 1 if a chain has ended, or raise what has ended it."""
    done = finished.get()
    if isinstance(done, BaseException):
        raise done
    if done is None:
        return 1
    yield done
    return 0


def processes(
    wanted: int, threads: int, *, tasks: int, gop_bytes: int, seconds: float
) -> tuple[int, int]:
    """Return the number of processes, and of the native threads of all of them together.

    One process for each thread is quicker than one process with many threads, because threads wait
    for each other in every step. But a process has to load its libraries and holds a GOP.

    Args:
        wanted: processes; 0 = by time and memory.
        threads: native threads; 0 = GSVR_THREADS or all cores.
        tasks: still to be done at the same time, the most processes that have work.
        gop_bytes: bytes of the frames of the largest GOP.
        seconds: expected time of a single process for all GOPs.
    """
    threads = resolve_threads(threads)
    if wanted == 0:
        wanted = threads if seconds > PROCESSES.least_seconds else 1
        each = PROCESSES.process_bytes + PROCESSES.fit_bytes * gop_bytes
        wanted = min(wanted, _available_bytes() // each)
    return max(1, min(wanted, tasks)), threads


def _available_bytes() -> int:
    """Return the memory that the system can give; without /proc/meminfo, plenty."""
    with suppress(OSError, ValueError):
        for line in Path("/proc/meminfo").read_text().splitlines():
            if line.startswith("MemAvailable:"):
                return int(line.split()[1]) * 1024
    return sys.maxsize


class _Worker:
    """A process that encodes one GOP at a time; killed on leaving its block.

    A plain subprocess, because `multiprocessing` runs the caller's script again, which must be
    prepared for that. Jobs and answers are pickled through pipes that nobody else holds.
    """

    def __enter__(self) -> Self:
        """Start the process."""
        code = f"import sys; sys.path[:] = {sys.path!r}; from {__name__} import serve; serve()"
        with _without_interrupts():
            self._process = subprocess.Popen(
                [sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE
            )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._jobs, self._answers = self._process.stdin, self._process.stdout
        self._ready = False
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Kill the process."""
        self._process.kill()
        self._process.wait()
        for pipe in (self._jobs, self._answers):
            with suppress(OSError):  # an unsent rest of a job is not wanted any more
                pipe.close()

    def __call__(self, job: GopJob) -> EncodedGop:
        """Encode a GOP in the process; raises as `encode_gop`."""
        began = time.perf_counter()
        try:
            if not self._ready:
                self._ready = pickle.load(self._answers)
            if job.seconds is not None:  # loading the libraries took a part of it
                left = job.seconds - (time.perf_counter() - began)
                job = replace(job, seconds=max(0.0, left))
            pickle.dump(job, self._jobs, pickle.HIGHEST_PROTOCOL)
            self._jobs.flush()
            answer = pickle.load(self._answers)
        except (EOFError, OSError, pickle.UnpicklingError) as error:
            raise WorkerError(
                f"the process that encoded the GOP at frame {job.first_frame} died (status "
                f"{self._process.wait()}); if memory ran out, use fewer `workers`"
            ) from error
        if isinstance(answer, BaseException):
            raise answer
        assert isinstance(answer, EncodedGop)
        return answer


@contextmanager
def _without_interrupts() -> Iterator[None]:
    """Start processes that a Ctrl-C at the terminal does not reach; their owner ends them."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def serve() -> None:
    """Encode the jobs of the standard input, one after another, until it ends."""
    source, target = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # text that a library prints is no answer
    jobs: queue.SimpleQueue[GopJob] = queue.SimpleQueue()

    def receive() -> None:
        """Queue the jobs that come; end the process when its owner is gone."""
        try:
            while True:
                jobs.put(pickle.load(source))
        finally:
            os._exit(0)

    threading.Thread(target=receive, daemon=True).start()
    answer = pickle.dumps(True)  # ready
    while True:
        target.write(answer)
        target.flush()
        answer = _answer(jobs.get())


def _answer(job: GopJob) -> bytes:
    """Return the pickled result, or the pickled error."""
    try:
        return pickle.dumps(encode_gop(job), pickle.HIGHEST_PROTOCOL)
    except Exception as error:
        return pickle.dumps(sendable(error))


def sendable(error: Exception) -> Exception:
    """Return an error as it is if it can be pickled, or else what it says."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error
