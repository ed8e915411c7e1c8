"""An executor on the workers of a Dask cluster."""

from __future__ import annotations

import logging
import os
import pickle
import tempfile
import threading
import time
from collections.abc import Mapping
from concurrent.futures import CancelledError, Executor, Future, InvalidStateError
from contextlib import suppress
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from gsvrcodec.encoder.chain import ChainTask, encode_chain, one_by_one
from gsvrcodec.encoder.gop import encode_gop
from gsvrcodec.encoder.results import EncodedGop
from gsvrcodec.encoder.run.local import sendable
from gsvrcodec.errors import ClusterError, UsageError, WorkerError
from gsvrcodec.versions import versions

#: Evaluated by workers, which may not have gsvrcodec at all.
VERSIONS = "__import__('gsvrcodec.versions', fromlist=['versions']).versions()"
#: Versions that must be the same, and those without which files may differ.
_REQUIRED, _WANTED = ("gsvrcodec", "bitstream", "sources"), ("native core", "NumPy", "Triton")
_log = logging.getLogger(__name__)


def fault(address: str, told: Any) -> str | None:
    """Return why the versions of a worker forbid it; warn of versions that may change bytes."""
    if isinstance(told, ModuleNotFoundError):
        return f"the worker at {address} has no gsvrcodec ({told})"
    if not isinstance(told, Mapping):
        return f"the worker at {address} does not tell its version of gsvrcodec ({told})"
    own = versions()
    for name in (*_REQUIRED, *_WANTED):
        if told.get(name) == own[name]:
            continue
        what = f"has {name} {told.get(name)}, not {own[name]}"
        if name in _REQUIRED:
            return f"the worker at {address} {what}"
        _log.warning("a worker %s: the file may differ from one that is made here", what)
    return None


def encoded(data: bytes, threads: int) -> list[EncodedGop] | Exception:
    """Encode a pickled chain on a worker.

    Args:
        data: the chain.
        threads: native threads; 0 = GSVR_THREADS, or as many as the worker was started with.

    Returns:
        The GOPs of the chain, or the error.
    """
    from distributed import get_worker

    worker = get_worker()
    key = worker.get_current_task()
    if not threads and "GSVR_THREADS" not in os.environ:
        threads = worker.state.nthreads
    done: list[EncodedGop] = []
    try:
        task: ChainTask = pickle.loads(data)
        for gop in one_by_one(task.jobs(), encode_gop, lambda: threads):
            done.append(gop)
            known = worker.state.tasks.get(key)
            if known is None or known.state != "executing":
                break  # nobody wants it any more
    except Exception as error:
        return sendable(error)
    return done


if TYPE_CHECKING:
    from distributed import Client


#: Stands for the address in DASK_SCHEDULER_ADDRESS, or in Dask's configuration.
AUTO = "auto"
#: Seconds to wait for the scheduler at first.
_CONNECT_SECONDS = 5.0
#: Seconds to wait for a worker when there is none, as while a nanny starts one anew.
_PATIENCE_SECONDS = 30.0
#: Seconds from one look at the list of workers to the next.
_WATCH_SECONDS = 1.0
#: Workers that may die of a chain.
_DEATHS = 3
#: Chains whose frames are sent at the same time; more would only take memory.
_SENDERS = 2


class Cluster(Executor):
    """The workers of a Dask cluster, as the `executor` of `gsvrcodec.encode`.

    As a context manager it is left at the end; the cluster itself goes on. Workers that join later
    are used, those that die are replaced by others.

    Args:
        address: of the scheduler, such as "tcp://scheduler:8786"; the path of a scheduler file,
            NAME.json; or "auto" = as DASK_SCHEDULER_ADDRESS or Dask's configuration has it.

    Raises:
        UsageError: "auto", and no address is configured.
        ClusterError: `distributed` is not installed; nothing listens at the address; there are no
            workers; a worker has no gsvrcodec, or another version.
    """

    #: Without `threads`, a chain has as many as its worker was started with.
    threads_known_by_workers = True

    def __init__(self, address: str) -> None:
        self._changed = threading.Condition()
        self._crew: dict[str, bool] = {}  # whether each worker is free
        self._refused: set[str] = set()
        self._since = time.monotonic()  # there has been no worker
        self._over: Exception | None = None  # why nothing can be done any more
        self._sending = threading.Semaphore(_SENDERS)
        self._open: set[Future[list[EncodedGop]]] = set()
        self._client, self.address = _connected(address)
        try:
            self._look(refuse=True)
            while not self._crew:
                self._check()
                time.sleep(_WATCH_SECONDS / 4)
                self._look(refuse=True)
        except BaseException:
            self.shutdown()
            raise
        threading.Thread(target=self._watch, daemon=True, name="gsvr-cluster").start()

    @property
    def workers(self) -> int:
        """How many workers there are now, or 1 while there are none."""
        return max(1, len(self._crew))

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Have a chain encoded by the next worker that is free; `fn` is `encode_chain`.

        The future raises what `encode_chain` does, ClusterError if the cluster was lost, and
        WorkerError if the chain killed three workers. When it is cancelled the worker leaves off
        after the current GOP.
        """
        if fn is not encode_chain:
            raise TypeError("a Cluster encodes chains and nothing else")
        task, threads = args
        stored = tempfile.TemporaryFile()  # noqa: SIM115, closed when the chain is done
        pickle.dump(task, stored, pickle.HIGHEST_PROTOCOL)
        future: Future[list[EncodedGop]] = Future()
        self._open.add(future)
        threading.Thread(
            target=self._fit, args=(future, stored, task.first_frame, threads), daemon=True
        ).start()
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = True) -> None:
        """Leave the cluster; chains that are not done are cancelled."""
        with self._changed:
            self._over = self._over or ClusterError("the cluster has been left")
            self._changed.notify_all()
        for future in list(self._open):
            future.cancel()
        lost = self._client.status != "running"
        with suppress(Exception):
            self._client.close(timeout=_CONNECT_SECONDS / 2)
        _quiet(lost)  # what it says of a lost one comes late, and has been said

    def _fit(
        self, future: Future[list[EncodedGop]], stored: IO[bytes], first: int, threads: int
    ) -> None:
        """Have a chain done, by one worker after another until one does not die."""
        try:
            with stored:
                found = self._done(future, stored, first, threads)
            if isinstance(found, Exception):
                raise found
        except CancelledError:
            future.cancel()
        except BaseException as error:
            with suppress(InvalidStateError):  # it was cancelled meanwhile
                future.set_exception(error)
        else:
            with suppress(InvalidStateError):
                future.set_result(found)
        finally:
            self._open.discard(future)

    def _done(
        self, future: Future[list[EncodedGop]], stored: IO[bytes], first: int, threads: int
    ) -> list[EncodedGop] | Exception:
        deaths = 0
        while True:
            address = self._take(future)
            try:
                return self._done_by(address, future, stored, threads)
            except Exception as error:
                if future.cancelled():
                    raise CancelledError from error
                with self._changed:
                    self._crew.pop(address, None)
                self._check()
                deaths += 1
                _log.debug("worker %s, chain at frame %d: %r", address, first, error)
                if deaths == _DEATHS:
                    raise WorkerError(
                        f"{deaths} workers died of the chain of GOPs at frame {first} or could not "
                        f"be reached from here, the last one at {address}; if memory ran out, give "
                        "workers more of it or shorten chains with `keyint`"
                    ) from error
            finally:
                with self._changed:
                    if address in self._crew:
                        self._crew[address] = True
                    self._changed.notify_all()

    def _done_by(
        self, address: str, future: Future[list[EncodedGop]], stored: IO[bytes], threads: int
    ) -> list[EncodedGop] | Exception:
        """Send a chain to a worker; return its GOPs or its error; raise if the worker died."""
        place = {"workers": [address], "allow_other_workers": False}
        with self._sending:
            stored.seek(0)
            sent = self._client.scatter(stored.read(), [address], direct=True, hash=False)
        remote = self._client.submit(encoded, sent, threads, pure=False, **place)
        future.add_done_callback(lambda done: remote.cancel() if done.cancelled() else None)
        found: list[EncodedGop] | Exception = remote.result()
        if isinstance(found, Exception):
            found.add_note(f"this came from the worker at {address}")
        return found

    def _take(self, future: Future[list[EncodedGop]]) -> str:
        """Wait for a worker that is free, and return its address."""
        with self._changed:
            while True:
                if future.cancelled():
                    raise CancelledError
                self._check()
                for address, free in self._crew.items():
                    if free:
                        self._crew[address] = False
                        return address
                self._changed.wait(_WATCH_SECONDS)

    def _check(self) -> None:
        """Raise why nothing can be done any more, if so."""
        if self._over is None and self._client.status != "running":
            self._over = ClusterError(f"the scheduler at {self.address} was lost")
        if not self._crew and time.monotonic() - self._since > _PATIENCE_SECONDS:
            self._over = self._over or ClusterError(
                f"the cluster at {self.address} has had no worker for {_PATIENCE_SECONDS:.0f} s"
            )
        if self._over is not None:
            raise self._over

    def _watch(self) -> None:
        """Keep the list of workers up to date."""
        while self._over is None:
            time.sleep(_WATCH_SECONDS)
            with suppress(Exception):  # a scheduler that is lost is seen by `_check`
                self._look(refuse=False)
            with self._changed:
                self._changed.notify_all()

    def _look(self, *, refuse: bool) -> None:
        """Take in workers that have come and leave out those that have gone.

        Args:
            refuse: raise for workers with other versions, instead of leaving them out.
        """
        there = set(self._client.nthreads())
        come = there - self._crew.keys() - self._refused
        told = self._client.run(eval, VERSIONS, workers=list(come), on_error="return")
        for address in come:
            wrong = fault(address, told.get(address))
            if wrong and refuse:
                raise ClusterError(wrong)
            if wrong:
                _log.warning("%s; it is left out", wrong)
                self._refused.add(address)
        come -= self._refused
        with self._changed:
            for address in self._crew.keys() - there:
                del self._crew[address]
            self._crew |= dict.fromkeys(come, True)
            if self._crew:
                self._since = time.monotonic()


def _connected(address: str) -> tuple[Client, str]:
    """Return a client of a cluster, and the address of its scheduler."""
    try:
        import dask
        from distributed import Client
    except ImportError as error:
        raise ClusterError("clusters need Dask's `distributed`: pip install distributed") from error
    if address == AUTO:
        address = dask.config.get("scheduler-address", None) or ""
        if not address:
            raise UsageError(
                "`cluster='auto'` takes the address of the scheduler from DASK_SCHEDULER_ADDRESS, "
                "which is not set"
            )
    where = {"scheduler_file": address} if address.endswith(".json") else {"address": address}
    if "scheduler_file" in where and not Path(address).exists():
        raise ClusterError(f"{address}: there is no such scheduler file")
    _quiet(True)
    try:
        client = Client(
            **where, timeout=_CONNECT_SECONDS, set_as_default=False, direct_to_workers=True
        )
    except Exception as error:
        _quiet(False)
        raise ClusterError(
            f"no scheduler of a cluster answers at {address} within {_CONNECT_SECONDS:.0f} s"
        ) from error
    return client, address


def _quiet(on: bool) -> None:
    """Keep Dask from writing to the standard error; our errors say the same in one sentence."""
    for name in ("distributed", "distributed.client"):
        logging.getLogger(name).setLevel(logging.CRITICAL if on else logging.WARNING)
