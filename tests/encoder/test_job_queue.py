"""Jobs of an encode: which frames each gets, how much time, and in front of which background."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gsvrcodec.encoder.background import StaticRun
from gsvrcodec.encoder.budget import Budget
from gsvrcodec.encoder.checkpoint import Checkpoint
from gsvrcodec.encoder.job_queue import (
    FittedBackground,
    fit_backgrounds,
    gop_jobs,
    processes_for,
)
from gsvrcodec.encoder.jobs import GopJob
from gsvrcodec.encoder.plan import PlannedBackground
from gsvrcodec.encoder.settings import EncodeSettings
from gsvrcodec.errors import InputError
from gsvrcodec.video import open_video
from tests import making

GOPS = [range(4), range(4, 10), range(10, 12)]
BUDGETS = [Budget(10), Budget(20), Budget(30)]
PICTURE = np.random.default_rng(0).integers(0, 256, (24, 32, 3), np.uint8)
RUN = StaticRun(1, range(1, 3), 0.9, PICTURE)


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twelve frames, each of one level that is its number."""
    pictures = [np.full((24, 32, 3), 10 * number, np.uint8) for number in range(12)]
    return making.write_video(tmp_path_factory.mktemp("film") / "a.mkv", pictures)


def jobs(
    film: Path,
    gops: list[range] = GOPS,
    missing: list[range] = GOPS,
    *,
    began: float = 0.0,
    workers: int = 1,
    backgrounds: dict[range, FittedBackground] | None = None,
    **settings: Any,
) -> list[GopJob]:
    chosen = EncodeSettings(**settings)
    with open_video(film) as video:
        found = gop_jobs(video, gops, BUDGETS, chosen, missing, workers, began, backgrounds or {})
        return list(found)


class TestGopJobs:
    def test_each_has_its_frames_and_times(self, film: Path) -> None:
        found = jobs(film)
        assert [job.budget for job in found] == BUDGETS
        with open_video(film) as video:
            shots = list(video)
        for gop, job in zip(GOPS, found, strict=True):
            assert job.first_frame == gop.start
            assert job.seconds is None
            assert job.background is None
            own = shots[gop.start : gop.stop]
            np.testing.assert_array_equal(job.frames, [shot.rgb for shot in own])
            assert job.pts.tolist() == [shot.pts for shot in own]
            assert job.durations.tolist() == [shot.duration for shot in own]

    def test_finished_gops_are_passed_over(self, film: Path) -> None:
        (job,) = jobs(film, missing=GOPS[1:2])
        assert job.first_frame == 4
        assert job.budget == BUDGETS[1]
        np.testing.assert_array_equal(job.frames[:, 0, 0, 0], jobs(film)[1].frames[:, 0, 0, 0])

    def test_the_time_left_is_shared_by_frames(
        self, film: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        now = 100.0
        monkeypatch.setattr("time.perf_counter", lambda: now)
        shares = [job.seconds for job in jobs(film, began=94.0, time_budget=1.0)]
        # No time goes by here: each share is of the six seconds left of twelve.
        assert shares == pytest.approx([6 * 4 / 12, 6 * 6 / 8, 6 * 2 / 2])
        shares = [job.seconds for job in jobs(film, began=94.0, workers=3, time_budget=1.0)]
        assert shares == pytest.approx([6 * 4 / 6, 6, 6 * 2 / 6])
        assert [job.seconds for job in jobs(film, began=0.0, time_budget=1.0)] == [0, 0, 0]

    def test_a_film_that_became_shorter_fails(self, film: Path) -> None:
        longer = [*GOPS[:2], range(10, 15)]
        with pytest.raises(InputError, match="became shorter while it was read"):
            jobs(film, longer, longer)


class TestBackgrounds:
    def test_they_are_fitted_once_and_kept(self, film: Path) -> None:
        settings = EncodeSettings(preset="fastest", threads=1)
        planned, reports = [PlannedBackground(RUN, Budget(25))], list[int]()
        with Checkpoint(None, {}, resume=False, restart=False) as checkpoint:
            found = fit_backgrounds(
                planned, GOPS, settings, checkpoint, lambda: reports.append(checkpoint.backgrounds)
            )
            again = fit_backgrounds(
                planned, GOPS, settings, checkpoint, lambda: reports.append(checkpoint.backgrounds)
            )
            assert reports == [1]
            assert checkpoint.background(1) == found[GOPS[1]].payload
        assert set(found) == set(again) == set(GOPS[1:])
        fitted = found[GOPS[1]]
        assert fitted is found[GOPS[2]]
        assert fitted.payload == again[GOPS[1]].payload
        assert fitted.background.number == 1
        assert len(fitted.background.gop) == 25
        before, *behind = jobs(film, backgrounds=found)
        assert before.background is None
        for job in behind:
            assert job.background is fitted.background
            assert job.background_picture is PICTURE


@pytest.mark.parametrize(
    ("settings", "count"),
    [
        ({"workers": 2}, 2),
        ({"workers": 9}, 3),
        ({"device": "cuda:0"}, 1),
        ({"device": "cuda:0", "workers": 2}, 2),
        ({"device": "cpu", "preset": "fastest"}, 1),
        ({"device": "cpu", "time_budget": 1e4}, 3),
    ],
)
def test_processes(settings: dict[str, Any], count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gsvrcodec.encoder.workers._available_bytes", lambda: 2**40)
    chosen = EncodeSettings(threads=4, **settings)
    assert processes_for(GOPS, (32, 24), chosen) == (count, 4)


def test_no_processes_for_nothing() -> None:
    assert processes_for([], (32, 24), EncodeSettings(threads=4))[0] == 1
