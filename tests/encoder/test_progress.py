"""How far an encode has come, by what its checkpoint holds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from fractions import Fraction

import pytest

from gsvrcodec.encoder.checkpoint import Checkpoint
from gsvrcodec.encoder.film import Chain
from gsvrcodec.encoder.progress import Meter, Progress
from gsvrcodec.encoder.results import EncodedGop

GOPS = [range(4), range(4, 10), range(10, 12)]


@dataclass
class Film:
    gops: list[range]
    chains: list[Chain]
    complete: bool = True
    durations: list[int] = field(default_factory=lambda: [2] * 12)


def done(gop: range, psnr: float) -> EncodedGop:
    payload = bytes(10 * len(gop))
    return EncodedGop(frames=gop, psnr=psnr, float_psnr=psnr, seconds=1.0, payload=payload)


def meter_of(
    film: Film,
    checkpoint: Checkpoint,
    began: float,
    call: Callable[[Progress], None] | None,
    expected: int | None = None,
) -> Meter:
    """Return a meter; a tick is 1/50 s, and a frame is expected to take 6 s / workers."""
    return Meter(film, checkpoint, began, call, Fraction(1, 50), expected, lambda n: 6 / n)


def test_gops_and_time(monkeypatch: pytest.MonkeyPatch) -> None:
    now, calls = 100.0, list[Progress]()
    monkeypatch.setattr("time.perf_counter", lambda: now)
    with Checkpoint(None, {}, resume=False, restart=False) as checkpoint:
        checkpoint.add(done(GOPS[0], 30.0))
        film = Film(GOPS[:2], [GOPS[:2]], complete=False)
        meter = meter_of(film, checkpoint, 90.0, calls.append, 11)
        meter.workers = lambda: 3
        meter.report()
        film.gops, film.chains, film.complete = GOPS, [GOPS[:2], GOPS[2:]], True
        checkpoint.add(done(GOPS[2], 36.0))
        meter.report()
        now = 110.0
        checkpoint.add(done(GOPS[1], 33.0))
        meter.report()
    assert [call.gop for call in calls] == [1, 2, 3]
    assert [call.chains_done for call in calls] == [0, 1, 2]
    assert {call.workers for call in calls} == {3}
    assert [(call.gops, call.chains, call.frames) for call in calls] == [
        *((2, 1, 11), (3, 2, 12), (3, 2, 12)),
    ]
    assert [call.analysed for call in calls] == [False, True, True]
    assert [call.frames_done for call in calls] == [4, 6, 12]
    assert [call.psnr for call in calls] == [30.0, 32.0, 32.5]
    # What was there before says nothing about the pace.
    assert [call.seconds_per_frame for call in calls] == [None, 5.0, 2.5]
    assert [call.eta_seconds for call in calls] == [42.0, 30.0, 0.0]
    assert {call.bitrate for call in calls} == {8 * 10 * 25.0}


def test_a_plate_that_chains_share_counts_once() -> None:
    calls = list[Progress]()
    with Checkpoint(None, {}, resume=False, restart=False) as checkpoint:
        for gop, plate in zip(GOPS, (15, 15, 5), strict=True):
            checkpoint.add(replace(done(gop, 30.0), plate_bytes=plate))
        meter_of(Film(GOPS, [GOPS]), checkpoint, 0.0, calls.append).report()
    assert [call.bitrate for call in calls] == [pytest.approx(8 * (120 - 15) / (12 * 2 / 50))]


def test_a_film_of_unknown_length_has_no_eta() -> None:
    calls = list[Progress]()
    with Checkpoint(None, {}, resume=False, restart=False) as checkpoint:
        film = Film(GOPS[:2], [GOPS[:2]], complete=False)
        meter = meter_of(film, checkpoint, 0.0, calls.append)
        checkpoint.add(done(GOPS[0], 30.0))
        meter.report()
        film.complete = True
        meter.report()
    assert [call.frames for call in calls] == [10, 10]
    assert calls[0].seconds_per_frame is not None
    assert [call.eta_seconds is None for call in calls] == [True, False]


def test_nobody_wants_to_know() -> None:
    with Checkpoint(None, {}, resume=False, restart=False) as checkpoint:
        meter_of(Film(GOPS, [GOPS]), checkpoint, 0.0, None).report()


def test_before_any_gop_is_known() -> None:
    calls = list[Progress]()
    with Checkpoint(None, {}, resume=False, restart=False) as checkpoint:
        film = Film([], [], complete=False, durations=[2] * 3)
        meter_of(film, checkpoint, 0.0, calls.append, 12).report("analysing")
    (call,) = calls
    assert (call.phase, call.frames_analysed, call.frames) == ("analysing", 3, 12)
    assert (call.psnr, call.bitrate, call.eta_seconds) == (None, None, 72.0)
