"""One GOP at a time: a pure function of its job, for every size and setting."""

from __future__ import annotations

import hashlib
import pickle
import random
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from statistics import fmean
from typing import Any, get_args

import cv2
import numpy as np
import pytest

from gsvrcodec.bitstream.gop_head import parse_gop_head
from gsvrcodec.encoder.gop import encode_gop
from gsvrcodec.encoder.job import GopJob, Reference
from gsvrcodec.encoder.plan import Budget
from gsvrcodec.encoder.results import EncodedGop
from gsvrcodec.fit.footage import Frames
from gsvrcodec.fit.recipe import Deform
from gsvrcodec.fit.target import Count, Quality, Size, Slope, Target
from tests import making
from tests.fit.synthetic import (
    assert_finite,
    decoded,
    gop_job,
    moving_texture,
    quality,
    sample,
    unpacked,
)

SIZE = (96, 64)
SHAPES = [(1, 1, 1), (1, 33, 47), (2, 1, 9), (3, 7, 1), (2, 135, 241), (5, 2, 3)]


class TestContent:
    def test_decodes_to_what_was_said(self) -> None:
        frames = sample(making.BUNNY_SMALL, (161, 97), 6)
        job = gop_job(frames, 300, first_frame=40)
        done = encode_gop(job)
        content = unpacked(done, job)
        assert content.first_frame == 40
        assert len(content.new) == 300
        np.testing.assert_array_equal(content.pts, job.pts)
        np.testing.assert_array_equal(content.durations, job.durations)
        assert quality(decoded(done, job), job) == pytest.approx(done.psnr, abs=0.02)
        assert done.psnr > 20
        assert abs(done.float_psnr - done.psnr) < 0.3

    @pytest.mark.parametrize("deform", get_args(Deform))
    @pytest.mark.parametrize("profile", ["main", "paper"])
    def test_every_deformation(self, deform: Deform, profile: str) -> None:
        frames = moving_texture(4, (1.5, 0.5), (96, 64))
        job = gop_job(frames, 200, deform=deform, profile=profile)
        done = encode_gop(job)
        gop = decoded(done, job)
        assert_finite(gop)
        assert bool(gop.xy.size) == (deform != "polynomial")
        assert gop.linear.any() == (deform != "triplane")
        assert done.psnr > 14

    @pytest.mark.parametrize("profile", ["main", "paper"])
    def test_qat(self, profile: str) -> None:
        frames = sample(making.BUNNY_SMALL, (96, 64), 4)
        jobs = [gop_job(frames, 200, qat=qat, profile=profile) for qat in (True, False)]
        with_it, without = map(encode_gop, jobs)
        assert with_it.payload != without.payload
        assert with_it.psnr > without.psnr - 0.5

    def test_rounding_costs_little(self) -> None:
        frames = sample(making.BUNNY_SMALL, (160, 96), 6)
        done = [encode_gop(gop_job(frames, 700, seed=seed)) for seed in range(3)]
        assert fmean(gop.float_psnr - gop.psnr for gop in done) < 0.25


def sized(size: int) -> Size:
    """Return the target of so many bytes for six frames of 160x96, by about the right slope."""
    return Size(size, Slope(3600 / size, 9000))


class TestTargets:
    @pytest.mark.parametrize("size", [4000, 9000])
    def test_size(self, size: int) -> None:
        frames = sample(making.BUNNY_SMALL, (160, 96), 6)
        job = gop_job(frames, Budget(size // 9, sized(size)), first_frame=8)
        done = encode_gop(job)
        assert 0.97 * size <= len(done.payload) <= 1.01 * size
        assert quality(decoded(done, job), job) == pytest.approx(done.psnr, abs=0.02)

    @pytest.mark.parametrize("more", [0.0, 0.4, -0.3])
    def test_quality(self, more: float) -> None:
        """Of a fit by a slope; it is fitted once more where that falls short."""
        frames = sample(making.BUNNY_SMALL, (160, 96), 6)
        slope = Slope(1.0, 4000)
        usual = encode_gop(gop_job(frames, Budget(400, slope)))
        wanted = usual.psnr + more
        done = encode_gop(gop_job(frames, Budget(400, Quality(wanted, slope))))
        assert done.psnr == pytest.approx(wanted, abs=0.05)

    def test_slope(self) -> None:
        frames = sample(making.BUNNY_SMALL, (160, 96), 6)
        done = encode_gop(gop_job(frames, Budget(400, Slope(2.0, 400))))
        assert done.qscale == 2.0
        assert 1 < parse_gop_head(done.payload).gaussians < 400

    def test_more_bytes_are_better(self) -> None:
        frames = sample(making.BUNNY_SMALL, (160, 96), 4)
        small, large = (
            encode_gop(gop_job(frames, Budget(300, sized(size)))) for size in (3000, 6000)
        )
        assert large.psnr > small.psnr + 0.5


@pytest.fixture(scope="module")
def key() -> tuple[GopJob, EncodedGop]:
    """A key GOP of four frames of a texture that moves slowly."""
    job = gop_job(moving_texture(4, (0.5, 0), SIZE), 200, first_frame=3)
    return job, encode_gop(job)


def following(
    key: tuple[GopJob, EncodedGop],
    frames: Frames,
    budget: Budget | int = 200,
    *,
    frames_of_reference: int = 4,
    **settings: Any,
) -> GopJob:
    """The job of the GOP that is predicted from the key GOP."""
    job, done = key
    assert done.qscale is not None
    reference = Reference(decoded(done, job), 3, frames_of_reference, done.qscale, done.psnr)
    own = gop_job(frames, budget, first_frame=7, **settings)
    return replace(own, reference=reference, before=job.frames[-1])


class TestPredicted:
    GOES_ON = moving_texture(8, (0.5, 0), SIZE)[4:]
    STANDS = np.repeat(moving_texture(4, (0.5, 0), SIZE)[3:], 4, axis=0)

    @pytest.mark.parametrize(
        ("frames", "frames_of_reference"), [(4, 4), (1, 4), (2, 4), (4, 1), (1, 1)]
    )
    def test_decodes_to_what_was_said(
        self, key: tuple[GopJob, EncodedGop], frames: int, frames_of_reference: int
    ) -> None:
        job = following(key, self.GOES_ON[:frames], frames_of_reference=frames_of_reference)
        done = encode_gop(job)
        content = unpacked(done, job)
        assert (content.first_frame, content.reference) == (7, 4)
        assert content.carried is not None
        assert len(content.carried.mode) == 200
        assert content.carried.kept + len(content.new) == 200
        assert quality(decoded(done, job), job) == pytest.approx(done.psnr, abs=0.02)
        assert job.reference is not None
        assert done.qscale == job.reference.qscale
        assert done.float_psnr - done.psnr < 1

    @pytest.mark.parametrize("deform", get_args(Deform))
    def test_every_deformation(self, key: tuple[GopJob, EncodedGop], deform: Deform) -> None:
        job = following(key, moving_texture(4, (2, 1), SIZE), deform=deform)
        done = encode_gop(job)
        assert_finite(decoded(done, job))
        assert quality(decoded(done, job), job) == pytest.approx(done.psnr, abs=0.02)
        assert done.psnr > 17

    def test_what_changes_takes_bytes(self, key: tuple[GopJob, EncodedGop]) -> None:
        kept, sizes = [], []
        for frames in (self.STANDS, self.GOES_ON, self.GOES_ON // 8 * 7):
            job = following(key, frames, Budget(200, grid=(4, 3, 4)))
            done = encode_gop(job)
            content = unpacked(done, job)
            assert content.carried is not None
            kept.append(np.count_nonzero(content.carried.mode == 0))
            sizes.append(len(done.payload))
        assert sizes[0] < 0.85 * min(sizes[1:])
        assert kept[0] > 2 * max(kept[1:])

    def test_another_picture_begins_a_key_gop(self, key: tuple[GopJob, EncodedGop]) -> None:
        job = following(key, 255 - self.GOES_ON, Budget(200, grid=(4, 3, 4)))
        done = encode_gop(job)
        content = unpacked(done, job)
        assert content.carried is None
        assert (content.reference, len(content.new)) == (0, 200)

    def test_a_slope_has_a_key_gop_where_most_would_change(
        self, key: tuple[GopJob, EncodedGop]
    ) -> None:
        """It begins with as many Gaussians as were planned for one."""
        budget = Budget(150, Slope(0.3, 400), grid=(4, 3, 4))
        job = following(key, self.GOES_ON, budget)
        assert encode_gop(job).payload == encode_gop(replace(job, reference=None)).payload
        coarse = replace(budget, target=Slope(10.0, 400))
        for other in (coarse, replace(budget, predicted=True)):  # as it was in a first pass
            done = encode_gop(following(key, self.GOES_ON, other))
            assert parse_gop_head(done.payload).reference == 4

    def test_bytes_that_win_nothing_are_left(self, key: tuple[GopJob, EncodedGop]) -> None:
        size = int(4 * len(key[1].payload))
        done = encode_gop(following(key, self.GOES_ON, Budget(200, Size(size, Slope(3.0, 400)))))
        assert len(done.payload) < 0.9 * size
        assert done.float_psnr - done.psnr < 0.2

    def test_quality(self, key: tuple[GopJob, EncodedGop]) -> None:
        slope = Slope(1.0, 400)
        wanted = encode_gop(following(key, self.GOES_ON, Budget(200, slope))).psnr - 0.3
        target = Quality(wanted, slope)
        done = encode_gop(following(key, self.GOES_ON, Budget(200, target)))
        assert done.psnr == pytest.approx(wanted, abs=0.15)

    def test_it_depends_on_its_job_alone(self, key: tuple[GopJob, EncodedGop]) -> None:
        job = following(key, self.GOES_ON)
        first = encode_gop(job).payload
        for threads in (1, 2):
            settings = replace(job.settings, threads=threads)
            again = pickle.loads(pickle.dumps(replace(job, settings=settings)))
            assert encode_gop(again).payload == first
        seeded = replace(job, settings=replace(job.settings, seed=1))
        assert encode_gop(seeded).payload != first

    def test_no_time_left(self, key: tuple[GopJob, EncodedGop]) -> None:
        job = replace(following(key, self.GOES_ON), seconds=0.0)
        assert_finite(decoded(encode_gop(job), job))


class TestEverySize:
    @pytest.mark.parametrize("profile", ["main", "paper"])
    @pytest.mark.parametrize("shape", SHAPES, ids=str)
    def test_shape(self, shape: tuple[int, int, int], profile: str) -> None:
        frames = np.random.default_rng(0).integers(0, 256, (*shape, 3), np.uint8)
        job = gop_job(frames, 12, profile=profile)
        done = encode_gop(job)
        assert_finite(decoded(done, job))
        assert np.isfinite([done.psnr, done.float_psnr]).all()

    @pytest.mark.parametrize("gaussians", [1, 2, 5])
    @pytest.mark.parametrize("deform", get_args(Deform))
    def test_few_gaussians(self, gaussians: int, deform: Deform) -> None:
        job = gop_job(sample(making.NOISE, (40, 32), 3), gaussians, deform=deform)
        assert len(decoded(encode_gop(job), job)) == gaussians

    def test_more_gaussians_than_pixels(self) -> None:
        job = gop_job(sample(making.NOISE, (8, 6), 2), 100)
        assert len(decoded(encode_gop(job), job)) == 100

    @pytest.mark.parametrize("level", [0, 128, 255])
    def test_flat(self, level: int) -> None:
        frames = np.full((3, 40, 56, 3), level, np.uint8)
        assert encode_gop(gop_job(frames, 60)).psnr > 25

    def test_uneven_times(self) -> None:
        frames = sample(making.NOISE, (64, 48), 4)
        job = replace(gop_job(frames), pts=np.array([-90, 5, 6, 10**9], np.int64))
        done = encode_gop(job)
        np.testing.assert_array_equal(unpacked(done, job).pts, job.pts)

    def test_time_budget(self) -> None:
        done = encode_gop(gop_job(sample(making.NOISE, (64, 48), 3), seconds=0.3))
        assert done.psnr > 15

    def test_no_time_left(self) -> None:
        job = gop_job(sample(making.NOISE, (64, 48), 3), seconds=0.0)
        assert_finite(decoded(encode_gop(job), job))


class TestPurity:
    """The same job gives the same bytes, wherever and whenever."""

    def jobs(self) -> list[GopJob]:
        frames = sample(making.BUNNY_SMALL, (96, 64), 6)
        return [gop_job(frames[:3]), gop_job(frames[3:], first_frame=3)]

    def test_order_does_not_matter(self) -> None:
        first, second = self.jobs()
        forward = [encode_gop(first).payload, encode_gop(second).payload]
        backward = [encode_gop(second).payload, encode_gop(first).payload]
        assert forward == backward[::-1]

    @pytest.mark.parametrize(
        "target", [Count(), sized(3000), Quality(24.0, Slope(4.0, 400))], ids=str
    )
    def test_threads_do_not_matter(self, target: Target) -> None:
        job = self.jobs()[0]
        job = replace(job, budget=replace(job.budget, target=target))
        payloads = {
            encode_gop(replace(job, settings=replace(job.settings, threads=threads))).payload
            for threads in (1, 2, 3)
        }
        assert len(payloads) == 1

    def test_random_state_of_the_process_does_not_matter(self) -> None:
        def encoded(seed: int) -> bytes:
            random.seed(seed)
            cv2.setRNGSeed(seed)
            np.random.seed(seed)  # noqa: NPY002, the state that nothing may use
            return encode_gop(self.jobs()[0]).payload

        assert encoded(1) == encoded(2)

    def test_job_is_left_alone(self) -> None:
        job = self.jobs()[0]
        before = job.frames.copy()
        encode_gop(job)
        np.testing.assert_array_equal(job.frames, before)

    def test_process_does_not_matter(self) -> None:
        code = (
            "import hashlib\n"
            "from gsvrcodec.encoder.gop import encode_gop\n"
            "from tests.encoder.test_jobs import TestPurity\n"
            "print(hashlib.sha256(encode_gop(TestPurity().jobs()[1]).payload).hexdigest())"
        )
        root = Path(__file__).parent.parent.parent
        run = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=root
        )
        here = encode_gop(self.jobs()[1]).payload
        assert run.stdout.strip() == hashlib.sha256(here).hexdigest()
