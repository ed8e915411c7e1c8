"""GOPs side by side: the same bytes, few in memory, clean ends."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from gsvrcodec.encoder.budget import Budget
from gsvrcodec.encoder.jobs import GopJob
from gsvrcodec.encoder.settings import EncodeSettings
from gsvrcodec.encoder.workers import fit_gops, processes, starts
from gsvrcodec.errors import WorkerError

FRAMES = 3


def gop_job(number: int, *, gaussians: int = 20, seconds: float | None = None) -> GopJob:
    pictures = np.random.default_rng(number).integers(0, 256, (FRAMES, 24, 32, 3), np.uint8)
    return GopJob(
        frames=pictures,
        pts=np.arange(FRAMES) + FRAMES * number,
        durations=np.ones(FRAMES, np.int64),
        first_frame=FRAMES * number,
        budget=Budget(gaussians),
        settings=EncodeSettings(preset="fastest"),
        seconds=seconds,
    )


def payloads(workers: int, threads: int) -> dict[int, bytes]:
    jobs = (gop_job(number) for number in range(4))
    return {done.frames.start: done.gop.payload for done in fit_gops(jobs, workers, threads)}


def children() -> set[int]:
    """Processes that this one has started and that still run."""
    every = Path("/proc/self/task").glob("*/children")
    return {int(pid) for path in every for pid in path.read_text().split()}


needs_proc = pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="needs Linux")


def test_same_bytes_whatever_the_number() -> None:
    alone = payloads(1, 1)
    assert sorted(alone) == [0, 3, 6, 9]
    assert len(set(alone.values())) == 4
    assert payloads(1, 3) == alone
    assert payloads(2, 2) == alone


def test_no_more_jobs_are_taken_than_workers_are_free() -> None:
    taken = 0

    def jobs() -> Iterator[GopJob]:
        nonlocal taken
        for number in range(5):
            taken += 1
            yield gop_job(number)

    finished = 0
    for _ in fit_gops(jobs(), 2, 2):
        finished += 1
        assert taken <= finished + 2
    assert finished == 5


@needs_proc
def test_stopping_kills_the_processes() -> None:
    before = children()
    with closing(fit_gops((gop_job(number) for number in range(9)), 2, 2)) as fitted:
        next(fitted)
        assert len(children() - before) == 2
    assert children() == before


@needs_proc
def test_a_failure_comes_as_it_is_and_kills_the_processes() -> None:
    before = children()
    bad = gop_job(0)
    object.__setattr__(bad, "durations", bad.durations[:1])
    with pytest.raises(ValueError, match="timestamps and 1 durations"):
        list(fit_gops([bad, gop_job(1)], 2, 2))
    assert children() == before


@needs_proc
def test_a_killed_process_is_a_clear_error() -> None:
    before = children()
    fitted = fit_gops((gop_job(number, seconds=60) for number in range(2)), 2, 2)
    killer = threading.Timer(0.5, lambda: os.kill(min(children() - before), signal.SIGKILL))
    killer.start()
    began = time.monotonic()
    with pytest.raises(WorkerError, match=r"GOP at frame \d died \(status -9\).*fewer `workers`"):
        list(fitted)
    assert time.monotonic() - began < 30
    assert children() == before


@pytest.mark.parametrize(
    ("wanted", "gops", "gop_bytes", "seconds", "count"),
    [
        (0, 100, 10**6, 60, 4),
        (0, 3, 10**6, 60, 3),
        (0, 100, 10**6, 5, 1),
        (0, 100, 10**13, 60, 1),
        (0, 0, 0, 0, 1),
        (7, 100, 10**13, 5, 7),
        (7, 2, 10**6, 60, 2),
    ],
)
def test_processes(wanted: int, gops: int, gop_bytes: int, seconds: float, count: int) -> None:
    found = processes(wanted, 4, gops=gops, gop_bytes=gop_bytes, seconds=seconds)
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
