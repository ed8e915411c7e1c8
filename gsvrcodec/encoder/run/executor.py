"""Chains fitted by any `concurrent.futures.Executor`: other processes, or other machines."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    wait,
)

from gsvrcodec.encoder.chain import ChainTask, encode_chain
from gsvrcodec.encoder.results import EncodedGop
from gsvrcodec.errors import UsageError, WorkerError
from gsvrcodec.render.native import resolve_threads

#: Chains that are read and handed over before a worker is free for them.
AHEAD = 1
#: Attributes with the number of workers: of our executors, of MPI's, of Python's and loky's.
_COUNTS = ("workers", "num_workers", "_max_workers")


class OnExecutor:
    """Does tasks by an executor; a `Runner`.

    Args:
        executor: Any of `concurrent.futures`; it stays open.
        wanted: Tasks at the same time; 0 = as many as it has workers.
        threads: Native threads of each task; 0 = as `threads_of`.

    Raises:
        UsageError: The executor forks this process.
    """

    sends = True

    def __init__(self, executor: Executor, wanted: int, threads: int) -> None:
        check_executor(executor)
        self._executor, self._wanted, self._threads = executor, wanted, threads

    def at_once(self) -> int:
        """Return how many tasks are done at the same time now."""
        return workers_of(self._executor, self._wanted)

    def run(self, tasks: Iterator[ChainTask]) -> Generator[EncodedGop, None, None]:
        """Do all tasks; as `fit_on`."""
        return fit_on(self._executor, tasks, self._wanted, self._threads)


def check_executor(executor: Executor) -> None:
    """Refuse forks: they have none of the threads that they wait for, and hold our files open.

    Raises:
        UsageError: the executor forks this process.
    """
    context = getattr(executor, "_mp_context", None)
    if context is not None and context.get_start_method() == "fork":
        raise UsageError(
            "the executor forks this process, whose threads do not live on in a fork: give it "
            "mp_context=multiprocessing.get_context('spawn')"
        )


def workers_of(executor: Executor, wanted: int = 0) -> int:
    """Return how many chains an executor does at the same time.

    Args:
        executor: is asked; the cores of this machine if it does not tell.
        wanted: 1 or more = this, whatever it says.
    """
    told = (getattr(executor, name, None) for name in _COUNTS)
    return wanted or next((n for n in told if isinstance(n, int) and n > 0), resolve_threads(0))


def threads_of(executor: Executor, workers: int, threads: int) -> int:
    """Return the native threads of each chain.

    Args:
        executor: one that knows better says so by `threads_known_by_workers`.
        workers: chains at the same time.
        threads: of each chain; 0 = a share of the cores of this machine, one at least.
    """
    if threads or getattr(executor, "threads_known_by_workers", False):
        return threads
    return max(1, resolve_threads(0) // workers)


def fit_on(
    executor: Executor, tasks: Iterator[ChainTask], wanted: int, threads: int
) -> Generator[EncodedGop, None, None]:
    """Have chains encoded and yield the GOPs of each as soon as it is done.

    A chain is taken when a worker is free, and `AHEAD` more, so that few are in memory however long
    the film is. Closing the generator cancels the chains that have not begun; the executor stays
    open.

    Args:
        executor: runs `encode_chain`, or whatever it does for that, anywhere.
        tasks: chains; they are read when they are asked for.
        wanted: chains at the same time; 0 = as many as the executor has workers.
        threads: as `threads_of`.

    Raises:
        WorkerError: a process of the executor died, or somebody cancelled a chain.
        Exception: whatever `encode_gop` or the executor raises.
    """
    waiting: set[Future[list[EncodedGop]]] = set()
    try:
        for task in tasks:
            each = threads_of(executor, workers_of(executor, wanted), threads)
            waiting.add(executor.submit(encode_chain, task, each))
            del task
            full = len(waiting) >= workers_of(executor, wanted) + AHEAD
            yield from _finished(waiting, None if full else 0)
        while waiting:
            yield from _finished(waiting, None)
    except BrokenExecutor as error:
        raise WorkerError(
            f"a process of the executor died ({type(error).__name__}); if memory ran out, use "
            "fewer workers"
        ) from error
    except CancelledError as error:
        raise WorkerError("the executor cancelled a chain that was still wanted") from error
    finally:
        for future in waiting:
            future.cancel()


def _finished(
    waiting: set[Future[list[EncodedGop]]], timeout: float | None
) -> Generator[EncodedGop, None, None]:
    """Take out the chains that are done, after waiting so many seconds for one; None = until."""
    done, _ = wait(waiting, timeout, FIRST_COMPLETED)
    for future in done:
        waiting.remove(future)
        yield from future.result()
