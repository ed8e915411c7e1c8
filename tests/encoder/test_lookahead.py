"""The first pass: sections of a film, as soon as they are known."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice, pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gsvrcodec.encoder.checkpoint import Checkpoint
from gsvrcodec.encoder.lookahead import Lookahead, checksum
from gsvrcodec.encoder.settings import EncodeSettings
from gsvrcodec.encoder.tuned import LOOKAHEAD
from gsvrcodec.errors import InputError
from gsvrcodec.video import SourceFrame, VideoReader, open_video
from tests import making

#: Frames of the two shots of the film, 25 a second.
FIRST, SECOND = 20, 100


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    with open_video(making.NOISE, (96, 64, None, None)) as video:
        shots = [shot.rgb for shot in islice(video, FIRST)]
    there_and_back = [np.ascontiguousarray(255 - np.rot90(rgb, 2)) for rgb in shots + shots[::-1]]
    pictures = [*shots, *there_and_back, *there_and_back, *there_and_back[:20]]
    return making.write_video(tmp_path_factory.mktemp("film") / "a.mkv", pictures)


@pytest.fixture
def checkpoint() -> Iterator[Checkpoint]:
    with Checkpoint(None, {}, resume=False, restart=False) as found:
        yield found


@pytest.fixture
def short_sections(monkeypatch: pytest.MonkeyPatch) -> None:
    """Shots of two seconds are divided."""
    tuned = replace(LOOKAHEAD, seconds=1.0)
    monkeypatch.setattr("gsvrcodec.encoder.lookahead.LOOKAHEAD", tuned)


class Slow(VideoReader):
    """A film of which some frames come when they are let go."""

    def __init__(self, film: Path, held: int) -> None:
        with open_video(film) as video:
            super().__init__(video.info, video._part)
        self.go_on, self._held = threading.Event(), held

    def __iter__(self) -> Iterator[SourceFrame]:
        for number, frame in enumerate(super().__iter__()):
            if number == self._held:
                assert self.go_on.wait(20)
            yield frame


def lengths(film: Path, checkpoint: Checkpoint, **settings: Any) -> list[int]:
    """Frames of each section."""
    with (
        open_video(film) as video,
        Lookahead(video, EncodeSettings(**settings), checkpoint) as lookahead,
    ):
        found = list(lookahead.sections())
        assert lookahead.complete
        chains = [chain for section in found for chain in section.chains]
        assert lookahead.chains == chains
        assert lookahead.gops == [gop for chain in chains for gop in chain]
        assert lookahead.end() == sum(lookahead.durations)
    gops = lookahead.gops
    assert [gop.start for gop in gops] == [0, *(gop.stop for gop in gops[:-1])]
    spans = [section.chains[-1][-1].stop - section.chains[0][0].start for section in found]
    assert [section.seconds for section in found] == pytest.approx([n / 25 for n in spans])
    return spans


class TestSections:
    def test_a_shot_is_one(self, film: Path, checkpoint: Checkpoint) -> None:
        assert lengths(film, checkpoint) == [FIRST, SECOND]

    @pytest.mark.parametrize(
        "settings",
        [
            *({"bpp": 0.1}, {"bitrate": 10**5}, {"target_size": 10**5}, {"params": 10**5}),
            *({"time_budget": 1.0}, {"profile": "paper"}),
        ],
        ids=str,
    )
    @pytest.mark.usefixtures("short_sections")
    def test_all_is_one_where_something_is_shared_out(
        self, film: Path, checkpoint: Checkpoint, settings: dict[str, Any]
    ) -> None:
        assert lengths(film, checkpoint, **settings) == [FIRST + SECOND]

    @pytest.mark.parametrize("settings", [{"crf": 30}, {"gaussians": 9}])
    def test_shots_by_themselves_where_not(
        self, film: Path, checkpoint: Checkpoint, settings: dict[str, Any]
    ) -> None:
        assert lengths(film, checkpoint, **settings) == [FIRST, SECOND]

    @pytest.mark.parametrize(
        ("keyint", "expected"),
        # One leaves when the shot is more than twice as long.
        [(0.5, [25, 25, 50]), (0.4, [30, 30, 40]), (0, [25, 25, 50]), (3.0, [100])],
    )
    @pytest.mark.usefixtures("short_sections")
    def test_a_long_shot_is_divided_into_whole_chains(
        self, film: Path, checkpoint: Checkpoint, keyint: float, expected: list[int]
    ) -> None:
        assert lengths(film, checkpoint, keyint=keyint) == [FIRST, *expected]


class TestAhead:
    def test_the_first_section_is_known_before_the_film_is_read(
        self, film: Path, checkpoint: Checkpoint
    ) -> None:
        video = Slow(film, FIRST + 10)
        with video, Lookahead(video, EncodeSettings(), checkpoint) as lookahead:
            sections = lookahead.sections()
            assert next(sections).chains[-1][-1].stop == FIRST
            assert not lookahead.complete
            known = lookahead.until(bool)
            assert known == lookahead.chains
            video.go_on.set()
            assert len(list(sections)) == 1
            assert lookahead.complete
        assert checkpoint.analysis is not None

    def test_leaving_ends_the_threads(self, film: Path, checkpoint: Checkpoint) -> None:
        before = threading.active_count()
        video = Slow(film, FIRST + 10)
        with video, Lookahead(video, EncodeSettings(), checkpoint) as lookahead:
            next(lookahead.sections())
            video.go_on.set()
        assert threading.active_count() == before
        assert checkpoint.analysis is None
        assert not lookahead.chains[1:]

    def test_what_reading_raises_comes_out_everywhere(
        self, film: Path, checkpoint: Checkpoint
    ) -> None:
        class Broken(Slow):
            def __iter__(self) -> Iterator[SourceFrame]:
                yield from islice(super().__iter__(), FIRST + 5)
                raise InputError("gone")

        with Broken(film, -1) as video, Lookahead(video, EncodeSettings(), checkpoint) as found:
            for ask in (found.end, lambda: list(found.sections()), lambda: found.until(bool)):
                with pytest.raises(InputError, match="gone"):
                    ask()

    def test_an_analysis_that_was_kept_is_not_made_again(
        self, film: Path, checkpoint: Checkpoint
    ) -> None:
        expected = lengths(film, checkpoint)
        with open_video(film) as video:
            video.close()  # reading would fail
            with Lookahead(video, EncodeSettings(), checkpoint) as lookahead:
                assert lookahead.complete
                spans = [s.chains[-1][-1].stop - s.chains[0][0].start for s in lookahead.sections()]
        assert spans == expected
        assert len(lookahead.pts) == len(lookahead.stats) == FIRST + SECOND
        assert lookahead.end() == sum(lookahead.durations)


class TestFrames:
    def test_times_and_checksums(self, checkpoint: Checkpoint) -> None:
        with open_video(making.VFR_ROTATED) as video:
            frames = list(video)
            for _ in range(2):  # the second time from the checkpoint
                with Lookahead(video, EncodeSettings(), checkpoint, checksums=True) as lookahead:
                    assert lookahead.end() == frames[-1].pts + frames[-1].duration
                assert lookahead.pts == [frame.pts for frame in frames]
                assert lookahead.durations == [frame.duration for frame in frames]
                assert lookahead.checksums == [checksum(frame.rgb) for frame in frames]
            assert any(b - a != frames[0].duration for a, b in pairwise(lookahead.pts))

    def test_an_analysis_without_checksums_is_made_again_for_them(
        self, film: Path, checkpoint: Checkpoint
    ) -> None:
        with open_video(film) as video:
            for checksums in (False, True, False):
                with Lookahead(video, EncodeSettings(), checkpoint, checksums=checksums) as found:
                    found.end()
                analysis = checkpoint.analysis
                assert analysis is not None
                if checksums:
                    assert len(found.checksums) == len(analysis.checksums) == FIRST + SECOND
