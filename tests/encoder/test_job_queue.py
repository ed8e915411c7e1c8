"""Jobs of an encode: which chains are left, which frames each gets, and how much time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gsvrcodec.encoder.chain import all_tasks, finished_gops, missing_frames
from gsvrcodec.encoder.checkpoint import Checkpoint
from gsvrcodec.encoder.film import Chain, Section
from gsvrcodec.encoder.job import GopJob
from gsvrcodec.encoder.lookahead import Lookahead
from gsvrcodec.encoder.plan import Budget
from gsvrcodec.encoder.run.local import Processes
from gsvrcodec.encoder.settings import EncodeSettings
from gsvrcodec.encoder.source import ReadHere
from gsvrcodec.errors import InputError
from gsvrcodec.fit.footage import Frames
from gsvrcodec.video import open_video
from tests import making
from tests.encoder.chains import driven
from tests.gops import encoded, make_chain

CHAINS = [[range(4)], [range(4, 7), range(7, 10)], [range(10, 12)]]
GOPS = [gop for chain in CHAINS for gop in chain]
BUDGETS = [Budget(10), Budget(20), Budget(21), Budget(30)]
#: The second chain has two GOPs, the others one.
RESULTS = [list(map(encoded, chain, make_chain([3] * len(chain)))) for chain in CHAINS]


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twelve frames, each of one level that is its number."""
    pictures = [np.full((24, 32, 3), 10 * number, np.uint8) for number in range(12)]
    return making.write_video(tmp_path_factory.mktemp("film") / "a.mkv", pictures)


@dataclass(frozen=True)
class Times:
    """What an analysis knows of the times of frames."""

    pts: list[int]
    durations: list[int]


def times_of(film: Path) -> Times:
    with open_video(film) as video:
        shots = [(shot.pts, shot.duration) for shot in video]
    return Times(*map(list, zip(*shots, strict=True)))


def holding(*gops: range) -> Checkpoint:
    """A checkpoint that has some of the GOPs."""
    checkpoint = Checkpoint(None, {}, resume=False, restart=False)
    results = {
        gop: result
        for chain, own in zip(CHAINS, RESULTS, strict=True)
        for gop, result in zip(chain, own, strict=True)
    }
    for gop in gops:
        checkpoint.add(results[gop])
    return checkpoint


def sections(chains: list[Chain], settings: EncodeSettings) -> Iterator[Section]:
    """All chains as one section if something is shared out, else two sections."""
    parts = [chains] if settings.shares_out else [chains[:1], chains[1:]]
    return (Section(part, 1.0) for part in parts)


def budgets(section: Section) -> list[Budget]:
    """The budgets of a section of CHAINS."""
    first = [gop.start for gop in GOPS].index(section.chains[0][0].start)
    return BUDGETS[first : first + sum(map(len, section.chains))]


def jobs(
    film: Path,
    *finished: range,
    chains: list[Chain] = CHAINS,
    began: float = 0.0,
    workers: int = 1,
    **settings: Any,
) -> list[GopJob]:
    """Jobs of all chains with missing GOPs, each answered by its result."""
    found: list[GopJob] = []
    chosen = EncodeSettings(**settings)
    with open_video(film) as video, holding(*finished) as checkpoint:
        answers = [
            results[finished_gops(chain, checkpoint) :]
            for chain, results in zip(chains, RESULTS, strict=True)
            if missing_frames(chain, checkpoint)
        ]
        reader, parts = ReadHere(video, times_of(film), pack=False), sections(chains, chosen)
        queue = all_tasks(parts, budgets, chosen, checkpoint, began, reader, workers)
        for task, results in zip(queue, answers, strict=True):
            found += driven(task.jobs(), results)
    return found


class TestAllTasks:
    def test_each_has_its_frames_and_times(self, film: Path) -> None:
        found = jobs(film)
        assert [job.budget for job in found] == BUDGETS
        assert [job.reference is None for job in found] == [True, True, False, True]
        with open_video(film) as video:
            shots = list(video)
        for gop, job in zip(GOPS, found, strict=True):
            assert job.first_frame == gop.start
            assert job.seconds is None
            own = shots[gop.start : gop.stop]
            np.testing.assert_array_equal(job.frames, [shot.rgb for shot in own])
            assert job.pts.tolist() == [shot.pts for shot in own]
            assert job.durations.tolist() == [shot.duration for shot in own]

    def test_finished_chains_are_passed_over(self, film: Path) -> None:
        (job,) = jobs(film, *GOPS[:3])
        assert job.first_frame == 10
        assert job.budget == BUDGETS[3]
        np.testing.assert_array_equal(job.frames, jobs(film)[3].frames)
        assert jobs(film, *GOPS) == []

    def test_what_is_finished_behind_a_missing_gop_is_done_again(self, film: Path) -> None:
        found = jobs(film, GOPS[2])
        assert [job.first_frame for job in found] == [0, 4, 7, 10]

    def test_frames_are_read_when_a_gop_is_asked_for(self, film: Path) -> None:
        with open_video(film) as video, holding() as checkpoint:
            longer = [*CHAINS[:2], [range(10, 15)]]
            chosen, reader = EncodeSettings(), ReadHere(video, times_of(film), pack=False)
            parts = sections(longer, chosen)
            queue = all_tasks(parts, budgets, chosen, checkpoint, 0.0, reader, 1)
            for first in (0, 4):
                assert next(next(queue).jobs()).first_frame == first
            with pytest.raises(InputError, match="became shorter while it was read"):
                next(next(queue).jobs())


def numbers(pictures: Frames) -> list[int]:
    """Which frames of the film these are."""
    return [round(picture.mean() / 10) for picture in pictures]


class TestReadHere:
    @pytest.fixture
    def reader(self, film: Path) -> Iterator[ReadHere]:
        with open_video(film) as video:
            yield ReadHere(video, times_of(film), pack=False)

    def test_chains_are_read_side_by_side(self, reader: ReadHere) -> None:
        first = reader.read(CHAINS[1], 0)
        second = reader.read([range(8, 10), range(10, 12)], 0)
        found = [numbers(one.take(gop)) for gop in (0, 1) for one in (first, second)]
        assert found == [[4, 5, 6], [8, 9], [7, 8, 9], [10, 11]]

    def test_one_goes_on_where_another_has_ended(self, reader: ReadHere) -> None:
        gops = [range(2), range(5, 7), range(7, 9)]
        assert [numbers(reader.read([gop], 0).take(0)) for gop in gops] == list(map(list, gops))
        assert len(reader._readers) == 1

    def test_of_finished_gops_the_last_is_read(self, reader: ReadHere) -> None:
        frames = reader.read([range(4), range(4, 7), range(7, 10)], 2)
        assert [len(one) for one in frames.pictures] == [0, 3, 3]
        assert numbers(frames.take(1)) == [4, 5, 6]

    def test_some_pictures_ahead_of_the_chains(self, reader: ReadHere) -> None:
        assert numbers(reader.ahead.read([1, 3, 4])) == [1, 3, 4]
        chain = reader.read([range(1, 4), range(4, 12)], 0)
        assert numbers(chain.take(0)) == [1, 2, 3]
        assert numbers(reader.ahead.read([6, 11])) == [6, 11]
        assert numbers(chain.take(1)) == list(range(4, 12))


@pytest.mark.parametrize(
    ("settings", "count"),
    [
        ({"workers": 2}, 2),
        ({"workers": 9}, 4),
        ({"workers": 9, "plates": False}, 3),
        ({"device": "cuda:0"}, 1),
        ({"device": "cuda:0", "workers": 2}, 2),
        ({"device": "cpu", "preset": "fastest"}, 1),
        ({"device": "cpu", "time_budget": 1e4}, 4),
    ],
)
def test_processes(
    settings: dict[str, Any], count: int, film: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As many as chains; as GOPs, where a plate may part them."""
    monkeypatch.setattr("gsvrcodec.encoder.run.local._available_bytes", lambda: 2**40)
    assert processes_of(film, **settings) == (count, 4)


def test_no_processes_for_nothing(film: Path) -> None:
    assert processes_of(film, *GOPS)[0] == 1


def processes_of(film: Path, *finished: range, **settings: Any) -> tuple[int, int]:
    """Processes and threads for CHAINS, on four cores."""
    chosen = EncodeSettings(threads=4, **settings)
    with open_video(film) as video, holding(*finished) as checkpoint:
        lookahead = Lookahead(video, chosen, checkpoint)
        lookahead.chains, lookahead.complete = CHAINS, True
        found = Processes.for_film(lookahead, checkpoint, video.info, chosen)
        return found.workers, found.threads
