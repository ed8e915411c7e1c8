"""GOPs fitted side by side, each in a process of its own, or one after another in this one."""

from __future__ import annotations

import heapq
import os
import pickle
import queue
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import Self

from gsvrcodec.encoder.jobs import EncodedGop, GopTask, encode_gop
from gsvrcodec.errors import WorkerError
from gsvrcodec.native import _core

#: Below this a single process is done before others have started.
_WORTHWHILE_SECONDS = 10.0
#: Memory of a process, and of a fit for each byte of its frames (measured: 240 MB and 6 times).
_PROCESS_BYTES = 300 * 2**20
_FIT_BYTES = 7


@dataclass(frozen=True, slots=True, eq=False)
class FittedGop:
    """A finished task and how long it took."""

    frames: range  #: numbers of its frames
    gop: EncodedGop
    seconds: float  #: wall time


def fit_gops(
    tasks: Iterable[GopTask], workers: int, threads: int
) -> Generator[FittedGop, None, None]:
    """Encode GOPs, yielding each as soon as it is done; the results do not depend on `workers`.

    A task is taken when a worker is free for it, so that at most `workers` are in memory. Close
    the generator to stop: its processes are killed.

    Args:
        tasks: what to encode; their settings' `threads` are replaced.
        workers: processes to fit in; 1 = this one.
        threads: native threads of all workers together.

    Raises:
        WorkerError: a process died, as it does when memory runs out.
        Exception: whatever `encode_gop` raises.
    """
    if workers == 1:
        for task in tasks:
            yield _fitted(encode_gop, task, threads)
        return
    with ExitStack() as stack:
        # Left in the order of its lines from below: dead workers end the threads that ask them.
        pool = stack.enter_context(ThreadPoolExecutor(workers))
        idle: queue.SimpleQueue[tuple[_Worker, int]] = queue.SimpleQueue()
        for number in range(workers):
            share = threads // workers + (number < threads % workers)
            idle.put((stack.enter_context(_Worker()), max(1, share)))

        def fit(task: GopTask) -> FittedGop:
            worker, share = idle.get()
            try:
                return _fitted(worker, task, share)
            finally:
                idle.put((worker, share))

        running: set[Future[FittedGop]] = set()
        for task in tasks:
            running.add(pool.submit(fit, task))
            if len(running) == workers:
                done, running = wait(running, return_when=FIRST_COMPLETED)
                yield from (future.result() for future in done)
        while running:
            done, running = wait(running, return_when=FIRST_COMPLETED)
            yield from (future.result() for future in done)


def processes(
    wanted: int, threads: int, *, gops: int, gop_bytes: int, seconds: float
) -> tuple[int, int]:
    """Return how many processes are to encode, and native threads of all of them together.

    Threads in one step wait for each other, so that a process for each is quicker; but it has to
    load its libraries, and holds a GOP of its own.

    Args:
        wanted: processes; 0 = by what follows.
        threads: native threads; 0 = GSVR_THREADS or all cores.
        gops: still to be encoded; more processes than these have nothing to do.
        gop_bytes: RGB samples of the largest GOP.
        seconds: that a single process is expected to take for all.
    """
    threads = _core.resolve_threads(threads)
    if wanted == 0:
        wanted = threads if seconds > _WORTHWHILE_SECONDS else 1
        wanted = min(wanted, _available_bytes() // (_PROCESS_BYTES + _FIT_BYTES * gop_bytes))
    return max(1, min(wanted, gops)), threads


def _available_bytes() -> int:
    """Return the memory that the system can give; what it does not tell is plenty."""
    with suppress(OSError, ValueError):
        for line in Path("/proc/meminfo").read_text().splitlines():
            if line.startswith("MemAvailable:"):
                return int(line.split()[1]) * 1024
    return sys.maxsize


def starts(lengths: Sequence[int], workers: int) -> tuple[list[int], int]:
    """When each GOP's turn comes if time goes by frames: its start, and when the last one ends."""
    free = [0] * workers
    out = []
    for length in lengths:
        out.append(free[0])
        heapq.heapreplace(free, free[0] + length)
    return out, max(free)


def _fitted(encode: Callable[[GopTask], EncodedGop], task: GopTask, threads: int) -> FittedGop:
    began = time.perf_counter()
    gop = encode(replace(task, settings=replace(task.settings, threads=threads)))
    frames = range(task.first_frame, task.first_frame + len(task.frames))
    return FittedGop(frames, gop, time.perf_counter() - began)


class _Worker:
    """A process that encodes one GOP at a time; killed on leaving its block.

    A plain subprocess: those of `multiprocessing` run the caller's script again, which must be
    prepared for it. Tasks and answers are pickled between the two ends of its own pipes.
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
        self._tasks, self._answers = self._process.stdin, self._process.stdout
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
        for pipe in (self._tasks, self._answers):
            with suppress(OSError):  # what was not sent yet is not wanted any more
                pipe.close()

    def __call__(self, task: GopTask) -> EncodedGop:
        """Have a task done; raises as `encode_gop`."""
        began = time.perf_counter()
        try:
            if not self._ready:
                self._ready = pickle.load(self._answers)
            if task.seconds is not None:  # what it took to load the libraries is gone
                left = task.seconds - (time.perf_counter() - began)
                task = replace(task, seconds=max(0.0, left))
            pickle.dump(task, self._tasks, pickle.HIGHEST_PROTOCOL)
            self._tasks.flush()
            answer = pickle.load(self._answers)
        except (EOFError, OSError, pickle.UnpicklingError) as error:
            raise WorkerError(
                f"the process that encoded the GOP at frame {task.first_frame} died (status "
                f"{self._process.wait()}); if memory ran out, use fewer --workers"
            ) from error
        if isinstance(answer, BaseException):
            raise answer
        assert isinstance(answer, EncodedGop)
        return answer


@contextmanager
def _without_interrupts() -> Iterator[None]:
    """Start processes that a Ctrl-C at the terminal does not reach: their owner ends them."""
    if sys.platform == "win32":
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def serve() -> None:
    """Encode the tasks of the standard input, one after another, until it ends."""
    source, target = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints is no answer
    tasks: queue.SimpleQueue[GopTask] = queue.SimpleQueue()

    def receive() -> None:
        """Queue what comes; when the owner is gone, whatever this process does is in vain."""
        try:
            while True:
                tasks.put(pickle.load(source))
        finally:
            os._exit(0)

    threading.Thread(target=receive, daemon=True).start()
    answer = pickle.dumps(True)  # ready
    while True:
        target.write(answer)
        target.flush()
        answer = _answer(tasks.get())


def _answer(task: GopTask) -> bytes:
    """Return the pickled result, or the pickled error."""
    try:
        return pickle.dumps(encode_gop(task), pickle.HIGHEST_PROTOCOL)
    except Exception as error:
        try:
            answer = pickle.dumps(error)
            pickle.loads(answer)
        except Exception:
            return pickle.dumps(RuntimeError(f"{type(error).__name__}: {error}"))
        return answer
