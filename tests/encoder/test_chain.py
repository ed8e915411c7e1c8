"""Chains: each GOP is fitted to what a decoder has of the one before, and shares with the rest."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, get_args

import numpy as np
import pytest

import gsvrcodec
from gsvrcodec.bitstream.gop_payload import pack_gop
from gsvrcodec.encoder.chain import chain_jobs
from gsvrcodec.encoder.job import GopJob
from gsvrcodec.encoder.plan import Budget
from gsvrcodec.encoder.rate import visited_frames
from gsvrcodec.encoder.results import EncodedGop
from gsvrcodec.encoder.settings import EncodeSettings, Pack
from gsvrcodec.encoder.tuned import SIZE
from gsvrcodec.fit.target import Quality, Size, Slope, Target
from tests.encoder.chains import BUDGET, LENGTHS, PAYLOADS, RESULTS, driven, frames_of, ranges
from tests.gops import (
    BITS,
    assert_gops_equal,
    decode_all,
    encoded,
    make_file,
    make_gop,
    make_payload,
)
from tests.vectors.streams import a_plate


def jobs_of(
    budgets: Sequence[Budget] = (BUDGET,) * 4,
    results: Sequence[EncodedGop] = RESULTS,
    *,
    finished: int = 0,
    seconds: float | None = None,
    room: float | None = None,
    plate: bytes | None = None,
    **settings: Any,
) -> list[GopJob]:
    frames = frames_of([len(gop) for gop in ranges(LENGTHS)[: len(budgets)]])
    chosen = EncodeSettings(**settings)
    jobs = chain_jobs(frames, budgets, chosen, results[:finished], seconds, plate, room)
    return driven(jobs, results[finished:])


class TestJobs:
    def test_the_reference_is_what_a_decoder_has(self) -> None:
        wholes = decode_all(make_file(PAYLOADS))
        key, *predicted = jobs_of()
        assert key.reference is None
        for job, before in zip(predicted, wholes, strict=False):
            assert job.reference is not None
            assert_gops_equal(job.reference.gop, before.gop)
            assert job.reference.first_frame == before.first_frame
            assert job.reference.frames == len(before.pts)
            assert job.reference.qscale == 1.5

    def test_the_frame_before_is_at_hand(self) -> None:
        key, *predicted = jobs_of()
        assert key.before is None
        for job in predicted:
            assert job.before is not None
            np.testing.assert_array_equal(job.before, np.full((4, 6, 3), job.first_frame - 1))

    @pytest.mark.parametrize("finished", [1, 2, 3])
    def test_finished_gops_are_not_done_again(self, finished: int) -> None:
        resumed, rest = jobs_of(finished=finished), jobs_of()[finished:]
        assert [job.first_frame for job in resumed] == [job.first_frame for job in rest]
        for job, same in zip(resumed, rest, strict=True):
            assert job.reference is not None
            assert same.reference is not None
            assert_gops_equal(job.reference.gop, same.reference.gop)
            assert job.budget == same.budget
            assert job.before is not None
            assert same.before is not None
            np.testing.assert_array_equal(job.before, same.before)

    def test_a_key_gop_may_stand_within(self) -> None:
        """A GOP that was not predicted after all is the reference of the next one as it is."""
        payload = make_payload(12, frames=2, first_frame=3)
        alone = encoded(range(3, 5), payload, qscale=0.7)
        *_, job = jobs_of([BUDGET] * 3, [RESULTS[0], alone])
        assert job.reference is not None
        assert len(job.reference.gop) == 12
        assert (job.reference.first_frame, job.reference.frames) == (3, 2)
        assert (job.reference.qscale, job.reference.psnr) == (0.7, 30.0)

    def test_frames_are_let_go(self) -> None:
        frames = frames_of()
        jobs = chain_jobs(frames, [BUDGET] * 4, EncodeSettings(), [], None)
        next(jobs)
        jobs.send(RESULTS[0])
        assert [len(pictures) > 0 for pictures in frames.pictures] == [False, False, True, True]


class TestRoom:
    """A chain has so many bytes: a GOP is as coarse as what is left for it and the next asks."""

    SIZES = tuple(map(len, PAYLOADS))

    def targets(self, *planned: int, room: float, **options: Any) -> list[Slope | Size]:
        budgets = [Budget(30, Slope(2.0, 500), bytes=size) for size in planned]
        found = [job.budget.target for job in jobs_of(budgets, room=room, **options)]
        return [target for target in found if isinstance(target, Slope | Size)]

    def test_only_the_last_gop_has_to_meet_its_size(self) -> None:
        *first, last = self.targets(*self.SIZES, room=sum(self.SIZES))
        assert [isinstance(target, Slope) and target.qscale for target in first] == (
            pytest.approx([2.0] * 3)
        )
        assert isinstance(last, Size)
        assert last.bytes == self.SIZES[3]
        assert last.slope.qscale == pytest.approx(SIZE.fuller * 2.0)
        (alone,) = self.targets(1000, room=1000, results=[])
        assert alone == Size(1000, Slope(SIZE.fuller * 2.0, 500))

    @pytest.mark.parametrize(("share", "coarser"), [(0.7, True), (1.4, False)])
    def test_gops_make_up_for_those_before(self, share: float, coarser: bool) -> None:
        planned = [round(share * size) for size in self.SIZES]
        first, second, _, last = self.targets(*planned, room=sum(planned))
        assert first == Slope(2.0, 500)
        assert isinstance(second, Slope)
        assert (second.qscale > 2.0) == coarser
        assert isinstance(last, Size)
        assert last.bytes == max(1, sum(planned) - sum(self.SIZES[:3]))

    def test_there_is_always_something(self) -> None:
        *_, last = self.targets(10, 10, 10, room=30)
        assert isinstance(last, Size)
        assert last.bytes == 1

    def test_finished_gops_count(self) -> None:
        planned = [2 * size for size in self.SIZES]
        targets = self.targets(*planned, room=sum(planned))
        assert self.targets(*planned, room=sum(planned), finished=2) == targets[2:]

    def test_the_plate_of_the_chain_is_apart(self) -> None:
        """Whoever gives the bytes has counted it; any other plate takes bytes of the chain."""
        coded, times = a_plate(64, 48), (40 * np.arange(3), np.full(3, 40))
        results = [encoded(range(3), pack_gop(make_gop(20), *times, 0, BITS, plate=coded))]
        beside, within = (
            self.targets(5000, 5000, room=10_000, results=results, plate=plate)[1]
            for plate in (coded, b"another")
        )
        assert isinstance(beside, Size)
        assert isinstance(within, Size)
        assert beside.bytes == within.bytes + len(coded)


@pytest.mark.parametrize("target", [Slope(2.0, 500), Quality(30.0, Slope(2.0, 500))], ids=str)
def test_a_slope_or_a_quality_and_its_gaussians_stay(target: Target) -> None:
    jobs = jobs_of([Budget(80, target)] * 3)
    assert [job.budget.gaussians for job in jobs] == [80] * 3
    assert {job.budget.target for job in jobs} == {target}


class TestTime:
    def test_a_gop_may_take_less(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr("time.perf_counter", lambda: 7.0)
        jobs = jobs_of(seconds=60.0)
        # The clock stands still, so the last GOP gets all of it.
        assert jobs[-1].seconds == pytest.approx(60)

    def test_finished_gops_take_none(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr("time.perf_counter", lambda: 7.0)
        jobs = jobs_of(finished=2, seconds=10.0)
        # The clock stands still, so the last GOP gets all of it.
        steps = [visited_frames(length) for length in LENGTHS[2:]]
        assert [job.seconds for job in jobs] == pytest.approx([10 * steps[0] / sum(steps), 10])

    def test_time_is_kept_for_what_gops_take_beyond_theirs(
        self, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        clock = [7.0]
        monkeypatch.setattr("time.perf_counter", lambda: clock[0])
        jobs = chain_jobs(
            frames_of([len(gop) for gop in ranges(LENGTHS)]),
            (BUDGET,) * 4,
            EncodeSettings(),
            [],
            100.0,
        )
        job, times = next(jobs), []
        for result in RESULTS[:-1]:
            assert job.seconds is not None
            times.append(job.seconds)
            clock[0] += 1.25 * job.seconds  # a quarter more than it was given
            job = jobs.send(result)
        assert job.seconds is not None
        times.append(job.seconds)
        assert 1.25 * sum(times[1:]) == pytest.approx(100 - 1.25 * times[0])


def test_the_codec_of_planes_changes_no_picture() -> None:
    still = np.random.default_rng(0).integers(0, 256, (1, 24, 32, 3)).astype(np.uint8)
    settings: dict[str, Any] = {"gaussians": 20, "gop": 2, "preset": "fastest"}
    pictures = []
    for pack in get_args(Pack):
        done = gsvrcodec.encode(still.repeat(6, axis=0), fps=25, pack=pack, **settings)
        assert done.data is not None
        assert (done.gops, done.key_gops) == (3, 1)
        with gsvrcodec.open(done.data) as decoder:
            pictures.append(decoder[:].data)
    for own in pictures[1:]:
        np.testing.assert_array_equal(own, pictures[0])
