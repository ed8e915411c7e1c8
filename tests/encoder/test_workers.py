"""Chains side by side: the same bytes, few in memory, clean ends."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Generator, Iterator
from contextlib import closing, suppress
from dataclasses import replace
from pathlib import Path
from typing import Self

import numpy as np
import pytest

from gsvrcodec.encoder.chain import starts
from gsvrcodec.encoder.gop import encode_gop
from gsvrcodec.encoder.job import GopJob
from gsvrcodec.encoder.plan import Budget
from gsvrcodec.encoder.results import EncodedGop
from gsvrcodec.encoder.run.local import fit_gops, processes
from gsvrcodec.encoder.settings import EncodeSettings
from gsvrcodec.errors import WorkerError

FRAMES = 3


def gop_job(number: int, *, seconds: float | None = None) -> GopJob:
    pictures = np.random.default_rng(number).integers(0, 256, (FRAMES, 24, 32, 3), np.uint8)
    return GopJob(
        frames=pictures,
        pts=np.arange(FRAMES) + FRAMES * number,
        durations=np.ones(FRAMES, np.int64),
        first_frame=FRAMES * number,
        budget=Budget(20),
        settings=EncodeSettings(preset="fastest"),
        seconds=seconds,
    )


def chain(*jobs: GopJob) -> Generator[GopJob, EncodedGop, None]:
    """A chain of jobs, each of which has more Gaussians the larger the result before it is."""
    before = 0
    for job in jobs:
        result = yield replace(job, budget=Budget(20 + before))
        before = len(result.payload) // 50


def chains(*lengths: int) -> Iterator[Generator[GopJob, EncodedGop, None]]:
    """Chains of so many GOPs."""
    first = 0
    for length in lengths:
        yield chain(*map(gop_job, range(first, first + length)))
        first += length


def payloads(workers: int, threads: int) -> dict[int, bytes]:
    fitted = fit_gops(chains(2, 1, 3), workers, threads)
    return {done.frames.start: done.payload for done in fitted}


def children() -> set[int]:
    """Processes that this one has started and that still run."""
    found: set[int] = set()
    for path in Path("/proc/self/task").glob("*/children"):
        with suppress(FileNotFoundError):  # its thread has just ended
            found.update(map(int, path.read_text().split()))
    return found


needs_proc = pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="needs Linux")


def test_same_bytes_whatever_the_number() -> None:
    alone = payloads(1, 1)
    assert list(alone) == [0, 3, 6, 9, 12, 15]
    assert len(set(alone.values())) == 6
    assert payloads(1, 3) == alone
    assert payloads(2, 2) == alone


@pytest.mark.parametrize("workers", [1, 2])
def test_the_gops_of_a_chain_come_in_order(workers: int) -> None:
    """Each of them is asked for with the result of the one before, and with no other."""
    seen: list[tuple[int, bytes]] = []

    def watched(first: int) -> Generator[GopJob, EncodedGop, None]:
        for number in range(first, first + 3):
            result = yield gop_job(number)
            seen.append((FRAMES * number, result.payload))

    found = [
        (done.frames.start, done.payload)
        for done in fit_gops((watched(first) for first in (0, 3)), workers, workers)
    ]
    for part in (seen, found):
        starts = [start for start, _ in part]
        assert sorted(starts) == [0, 3, 6, 9, 12, 15]
        for own in ([0, 3, 6], [9, 12, 15]):
            assert [start for start in starts if start in own] == own
    assert dict(seen) == dict(found)


def test_no_more_chains_are_taken_than_workers_are_free() -> None:
    taken = 0

    def counted() -> Iterator[Generator[GopJob, EncodedGop, None]]:
        nonlocal taken
        for one in chains(1, 1, 1, 1, 1):
            taken += 1
            yield one

    finished = 0
    for _ in fit_gops(counted(), 2, 2):
        finished += 1
        assert taken <= finished + 2
    assert finished == 5


class Recorder:
    """In place of a process: notes the threads of each job."""

    def __init__(self) -> None:
        self.result = encode_gop(gop_job(0))
        self.threads: dict[int, int] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        pass

    def __call__(self, job: GopJob) -> EncodedGop:
        self.threads[job.first_frame // FRAMES] = job.execution.threads
        return self.result


def test_the_last_chain_has_all_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    recorder, shared, alone = Recorder(), threading.Event(), threading.Event()
    monkeypatch.setattr("gsvrcodec.encoder.run.local._Worker", lambda: recorder)

    def long() -> Generator[GopJob, EncodedGop, None]:
        yield gop_job(1)
        shared.set()
        assert alone.wait(10)
        yield gop_job(2)

    def short() -> Generator[GopJob, EncodedGop, None]:
        yield gop_job(0)
        assert shared.wait(10)

    def both() -> Iterator[Generator[GopJob, EncodedGop, None]]:
        yield long()
        yield short()
        threading.Timer(0.3, alone.set).start()  # asked for more: the short one has ended

    assert len(list(fit_gops(both(), 2, 5))) == 3
    assert sorted([recorder.threads[0], recorder.threads[1]]) == [2, 3]
    assert recorder.threads[2] == 5


@pytest.mark.parametrize("workers", [1, 2])
def test_a_chain_without_jobs_is_no_matter(workers: int) -> None:
    found = list(fit_gops(iter([chain(), chain(gop_job(3)), chain()]), workers, 2))
    assert [done.frames.start for done in found] == [9]


@needs_proc
def test_stopping_kills_the_processes() -> None:
    before = children()
    with closing(fit_gops(chains(3, 3, 3), 2, 2)) as fitted:
        next(fitted)
        assert len(children() - before) == 2
    assert children() == before


@needs_proc
def test_a_failure_comes_as_it_is_and_kills_the_processes() -> None:
    before = children()
    bad = gop_job(0)
    object.__setattr__(bad, "durations", bad.durations[:1])
    with pytest.raises(ValueError, match="timestamps and 1 durations"):
        list(fit_gops([chain(bad), chain(gop_job(1))], 2, 2))
    assert children() == before


@needs_proc
def test_a_killed_process_is_a_clear_error() -> None:
    before = children()
    fitted = fit_gops((chain(gop_job(number, seconds=60)) for number in range(2)), 2, 2)
    killer = threading.Timer(0.5, lambda: os.kill(min(children() - before), signal.SIGKILL))
    killer.start()
    began = time.monotonic()
    with pytest.raises(WorkerError, match=r"GOP at frame \d died \(status -9\).*fewer `workers`"):
        list(fitted)
    assert time.monotonic() - began < 30
    assert children() == before


@pytest.mark.parametrize(
    ("wanted", "many", "gop_bytes", "seconds", "count"),
    [
        (0, 100, 10**6, 60, 4),
        (0, 3, 10**6, 60, 3),
        (0, 100, 10**6, 5, 4),
        (0, 100, 10**6, 1, 1),
        (0, 100, 8 * 10**8, 60, 2),
        (0, 100, 10**13, 60, 1),
        (0, 0, 0, 0, 1),
        (7, 100, 10**13, 5, 7),
        (7, 2, 10**6, 60, 2),
    ],
)
def test_processes(
    wanted: int,
    many: int,
    gop_bytes: int,
    seconds: float,
    count: int,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("gsvrcodec.encoder.run.local._available_bytes", lambda: 16 * 10**9)
    found = processes(wanted, 4, tasks=many, gop_bytes=gop_bytes, seconds=seconds)
    assert found == (count, 4)


@pytest.mark.parametrize(
    ("lengths", "workers", "turns", "end"),
    [
        ([], 2, [], 0),
        ([5, 7, 4], 1, [0, 5, 12], 16),
        ([5, 7, 4], 2, [0, 0, 5], 9),
        ([5, 7, 4], 9, [0, 0, 0], 7),
    ],
)
def test_turns(lengths: list[int], workers: int, turns: list[int], end: int) -> None:
    assert starts(lengths, workers) == (turns, end)
