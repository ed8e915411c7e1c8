"""Chains fitted by executors: the same bytes, few in memory, clean ends."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import shutil
import signal
from collections.abc import Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gsvrcodec
from gsvrcodec.encoder.chain import ChainTask, encode_chain
from gsvrcodec.encoder.encode import EncodeResult
from gsvrcodec.encoder.progress import Progress
from gsvrcodec.encoder.run.executor import AHEAD, fit_on, threads_of, workers_of
from gsvrcodec.encoder.settings import EncodeSettings
from gsvrcodec.encoder.source import packed
from gsvrcodec.errors import InputError, UsageError, WorkerError
from tests import making
from tests.encoder.chains import BUDGET, RESULTS, frames_of

#: Two chains of two GOPs.
SETTINGS: dict[str, Any] = {
    **{"gop": 3, "keyint": 0.4, "frames": 11, "preset": "fastest"},
    **{"gaussians": 40, "pack": "deflate"},
}


def encode(target: Path, executor: Executor | None, **more: Any) -> EncodeResult:
    return gsvrcodec.encode(making.NOISE, target, executor=executor, **(SETTINGS | more))


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The file of an encode without executor."""
    target = tmp_path_factory.mktemp("whole") / "a.gsvr"
    encode(target, None, workers=1)
    return target.read_bytes()


@pytest.fixture(scope="module")
def pool() -> Iterator[ProcessPoolExecutor]:
    """Two processes."""
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as pool:
        yield pool


def tasks(count: int) -> Iterator[ChainTask]:
    """Chains without content."""
    for _ in range(count):
        yield ChainTask(frames_of(), [BUDGET] * 4, EncodeSettings(), RESULTS[:3], None)


class Waiting(Executor):
    """Does nothing until it is told to."""

    workers = 2

    def __init__(self, result: Any = ()) -> None:
        self.given: list[Future[Any]] = []
        self._result = result

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Keep what is given; do the oldest when enough are there."""
        assert fn is encode_chain
        future: Future[Any] = Future()
        self.given.append(future)
        open_ones = [future for future in self.given if not future.done()]
        assert len(open_ones) <= self.workers + AHEAD
        if len(open_ones) == self.workers + AHEAD:
            if isinstance(self._result, BaseException):
                open_ones[0].set_exception(self._result)
            else:
                open_ones[0].set_result(self._result)
        return future


class TestProcesses:
    """Processes of Python's own executor."""

    def test_same_bytes(self, pool: Executor, whole: bytes, tmp_path: Path) -> None:
        calls: list[Progress] = []
        encode(tmp_path / "a.gsvr", pool, progress=calls.append)
        assert (tmp_path / "a.gsvr").read_bytes() == whole
        assert list(dict.fromkeys(call.gop for call in calls)) == [0, 1, 2, 3, 4]

    def test_same_bytes_where_processes_read_the_source(
        self, pool: Executor, whole: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.chdir(making.NOISE.parent)
        target = tmp_path / "a.gsvr"
        gsvrcodec.encode(
            making.NOISE.name, target, executor=pool, shared_source=True, overwrite=True, **SETTINGS
        )
        assert target.read_bytes() == whole

    def test_another_file_than_was_analysed_ends_it(self, pool: Executor, tmp_path: Path) -> None:
        source, other = tmp_path / "in.mp4", tmp_path / "other.mp4"
        shutil.copy(making.NOISE, source)
        shutil.copy(making.BUNNY_SMALL, other)

        def change(state: Progress) -> None:
            if state.phase == "fitting" and not state.gop and other.exists():
                other.replace(source)  # at once: no worker may see a part of it

        # Two chains begin at the same time; either may be the first to see it.
        with pytest.raises(InputError, match=r"in\.mp4 has other pictures at 0\.(00|48) s"):
            gsvrcodec.encode(
                source,
                tmp_path / "a.gsvr",
                executor=pool,
                shared_source=True,
                progress=change,
                **SETTINGS,
            )

    def test_nothing_to_share(self, pool: Executor) -> None:
        with pytest.raises(UsageError, match="`shared_source` is for the workers of an `executor`"):
            gsvrcodec.encode(making.NOISE, shared_source=True)
        with pytest.raises(UsageError, match="`shared_source` needs a file that workers can read"):
            gsvrcodec.encode(making.NOISE.read_bytes(), executor=pool, shared_source=True)

    def test_a_killed_one_is_a_clear_error_and_what_is_done_is_kept(
        self, pool: ProcessPoolExecutor, tmp_path: Path
    ) -> None:
        """A third chain, which has not begun when the first one is done."""
        target, longer = tmp_path / "a.gsvr", {"frames": 20}

        def kill(state: Progress) -> None:
            if state.gop == 2:
                for process in pool._processes:
                    os.kill(process, signal.SIGKILL)

        with pytest.raises(WorkerError, match="a process of the executor died"):
            encode(target, pool, progress=kill, workers=1, **longer)
        assert target.with_name("a.gsvr.part").exists()
        encode(target, None, resume=True, workers=1, **longer)
        encode(tmp_path / "b.gsvr", None, workers=1, **longer)
        assert target.read_bytes() == (tmp_path / "b.gsvr").read_bytes()


class TestAnyExecutor:
    def test_same_bytes_from_threads(self, whole: bytes, tmp_path: Path) -> None:
        with ThreadPoolExecutor(2) as pool:
            encode(tmp_path / "a.gsvr", pool)
            assert not pool._shutdown
        assert (tmp_path / "a.gsvr").read_bytes() == whole

    def test_another_version_is_refused(self) -> None:
        (task,) = tasks(1)
        with pytest.raises(WorkerError, match=r"other sources .*\(\w{12}\) than .*\(no\)"):
            encode_chain(replace(task, sources="no"), 1)

    def test_what_was_interrupted_goes_on(self, whole: bytes, tmp_path: Path) -> None:
        """Within a chain, from GOPs that a local encode has finished."""
        target = tmp_path / "a.gsvr"

        def stop(state: Progress) -> None:
            if state.gop == 1:
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            encode(target, None, workers=1, progress=stop)
        with ThreadPoolExecutor(1) as pool:
            encode(target, pool, resume=True)
        assert target.read_bytes() == whole

    def test_few_chains_are_taken(self) -> None:
        executor = Waiting()
        taken = 0

        def counted() -> Iterator[ChainTask]:
            nonlocal taken
            for task in tasks(9):
                taken += 1
                yield task

        with pytest.raises(TimeoutError):
            # The last ones are never done: nobody hands in more.
            for _ in fit_on(executor, _then_give_up(counted()), 0, 1):
                pass
        assert taken == 9
        assert [future.done() for future in executor.given] == [True] * 9
        assert [future.cancelled() for future in executor.given] == [False] * 7 + [True] * 2

    def test_a_broken_one_is_a_clear_error(self) -> None:
        with pytest.raises(WorkerError, match=r"died \(BrokenProcessPool\).*fewer workers"):
            list(fit_on(Waiting(BrokenProcessPool()), tasks(9), 0, 1))

    def test_a_failure_comes_as_it_is(self) -> None:
        with pytest.raises(ValueError, match="of the chain"):
            list(fit_on(Waiting(ValueError("of the chain")), tasks(9), 0, 1))

    def test_one_that_is_shut_down_is_a_clear_error(self) -> None:
        class Closing(Waiting):
            def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
                future: Future[Any] = Future()
                future.cancel()
                future.set_running_or_notify_cancel()
                return future

        with pytest.raises(WorkerError, match="cancelled a chain"):
            list(fit_on(Closing(), tasks(1), 0, 1))

    @pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="no fork")
    def test_forks_are_refused(self, tmp_path: Path) -> None:
        pool = ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("fork"))
        with pool, pytest.raises(UsageError, match=r"get_context\('spawn'\)"):
            encode(tmp_path / "a.gsvr", pool)
        assert not list(tmp_path.iterdir())


def _then_give_up(given: Iterator[ChainTask]) -> Iterator[ChainTask]:
    yield from given
    raise TimeoutError


def test_workers_and_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GSVR_THREADS", "6")
    with ThreadPoolExecutor(3) as pool:
        assert (workers_of(pool), workers_of(pool, 5)) == (3, 5)
        assert [threads_of(pool, workers, 0) for workers in (1, 3, 5, 9)] == [6, 2, 1, 1]
        assert threads_of(pool, 3, 4) == 4
    assert workers_of(Waiting()) == 2
    unknown = Waiting()
    unknown.workers = 0
    assert workers_of(unknown) == 6
    unknown.threads_known_by_workers = True  # type: ignore[attr-defined]
    assert threads_of(unknown, 3, 0) == 0


@pytest.mark.parametrize("size", [(1, 1), (1, 40), (40, 1), (33, 70)])
@pytest.mark.parametrize("count", [0, 3])
def test_packed_pictures_are_the_same(size: tuple[int, int], count: int) -> None:
    pictures = np.random.default_rng(1).integers(0, 256, (count, *size, 3), np.uint8)
    pictures[:1] = 7
    there = pickle.loads(pickle.dumps(packed(pictures)))
    assert len(there) == count
    found = there.unpacked()
    assert found.dtype == np.uint8
    np.testing.assert_array_equal(found, pictures)
