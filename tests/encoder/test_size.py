"""A size or a PSNR of a film, and how chains and their GOPs keep to it."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gsvrcodec
from gsvrcodec import Progress
from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.encoder.film_target import FilmSize
from gsvrcodec.encoder.plan import Budget
from gsvrcodec.encoder.size import Rooms, Spending
from gsvrcodec.encoder.tuned import SIZE
from gsvrcodec.errors import UsageError
from tests import making
from tests.fit.synthetic import moving_texture
from tests.fit.test_plate import film


class TestRoom:
    SIZE = (320, 180)

    @pytest.mark.parametrize(
        ("argument", "value", "room"),
        [
            ("bpp", 0.2, 129_600 - 1000),
            ("bitrate", 800_000, 200_000 - 1000),
            ("target_size", 150_000, 150_000 - 1000 - 20_000),
        ],
    )
    def test_what_is_left_for_gops(self, argument: Any, value: float, room: int) -> None:
        """Copied streams count for the size of the file alone."""
        size = FilmSize(argument, value)
        left = size.room(self.SIZE, 90, 3, seconds=2.0, overhead=1000, streams=20_000)
        assert left == room

    @pytest.mark.parametrize(
        ("argument", "value", "message"),
        [
            ("bpp", 1e-5, "`bpp=1e-05` leaves 0 bytes for 1 GOP of at least"),
            ("bitrate", 5000, "`bitrate=5000` leaves 250 bytes"),
            ("target_size", 1200, "`target_size=1200` leaves 200 bytes"),
        ],
    )
    def test_too_little(self, argument: Any, value: float, message: str) -> None:
        with pytest.raises(UsageError, match=message):
            FilmSize(argument, value).room(self.SIZE, 30, 1, seconds=2.0, overhead=1000, streams=0)


class TestSpending:
    def test_as_planned(self) -> None:
        spending = Spending([100, 200, 300], 600)
        for size in (100, 200):
            assert not spending.is_last
            assert spending.coarser() == 1
            spending.add(size)
        assert (spending.is_last, spending.left) == (True, 300)
        assert spending.coarser() == SIZE.fuller

    def test_what_costs_more_will_cost_more(self) -> None:
        """A chain takes twice what was planned: its GOPs come to about its room all the same."""
        spending, sizes = Spending([100] * 12, 1200), []
        for _ in range(12):
            sizes.append(round(200 * spending.coarser() ** -SIZE.power))
            spending.add(sizes[-1])
        assert sizes[0] == 200
        assert min(sizes[2:]) > 60
        assert sum(sizes[:11]) == pytest.approx(1100, rel=0.06)

    def test_there_are_bounds(self) -> None:
        much, little = Spending([10, 10, 10], 9000), Spending([10, 10, 10], 30)
        little.add(900)
        assert (much.coarser(), little.coarser()) == (1 / SIZE.reach, SIZE.reach)


class TestRooms:
    def test_chains_make_up_for_plates(self) -> None:
        chains = [Budget(1, bytes=100, plate_bytes=50)], [Budget(1, bytes=300)]
        rooms = Rooms(400)
        assert rooms.of_chain(chains[0], 90) == 90
        assert rooms.of_chain(chains[1], 0) == 270
        rooms = Rooms(400)
        assert rooms.of_chain(chains[0], 50) == 100
        assert rooms.of_chain(chains[1], 0) == 300

    def test_any_room(self) -> None:
        assert Rooms(0).of_chain([Budget(1)], 90) is None


#: A quarter of the pictures: the bits of a pixel are what matters.
PART: dict[str, Any] = {"crop": (160, 90, 80, 40), "audio": False}


def met(source: Any, size: int, **options: Any) -> gsvrcodec.EncodeResult:
    settings = {"preset": "fastest", "workers": 1, "threads": 2, **options}
    result = gsvrcodec.encode(source, None, target_size=size, **settings)
    assert 0.97 * size <= result.bytes <= size
    return result


class TestFilms:
    @pytest.mark.parametrize(("size", "part"), [(20_000, {}), (5_000, PART), (12_000, PART)])
    def test_a_size_is_met(self, size: int, part: dict[str, Any]) -> None:
        met(making.BUNNY_SMALL, size, frames=32, **part)

    @pytest.mark.parametrize("psnr", [29.0, 35.0])
    def test_a_psnr_is_met(self, psnr: float) -> None:
        options: dict[str, Any] = {"preset": "fastest", "workers": 1, "threads": 2, **PART}
        found = gsvrcodec.encode(making.BUNNY_SMALL, None, target_psnr=psnr, **options)
        assert found.psnr == pytest.approx(psnr, abs=0.15)

    def test_it_is_as_good_as_a_constant_quality(self) -> None:
        """A locked camera has plates either way."""
        shots = film(24)
        shots[:, :, 130:] = moving_texture(24, (2, 1), (30, shots.shape[1]))
        options: dict[str, Any] = {"fps": 30, "gop": 8, "preset": "fastest", "workers": 1}
        free = gsvrcodec.encode(shots, None, crf=26, **options)
        found = met(shots, free.bytes, **options)
        assert found.psnr > free.psnr - 0.3
        same = gsvrcodec.encode(shots, None, target_psnr=free.psnr, **options)
        assert same.psnr == pytest.approx(free.psnr, abs=0.15)
        assert same.bytes < 1.1 * free.bytes
        for made in (found, same):
            assert made.data is not None
            with GsvrReader(io.BytesIO(made.data)) as reader:
                assert reader.header.plates
                assert {gop.reference_frame for gop in reader.gops} == {0}

    def test_a_chain_gives_its_last_gop_what_is_left(self) -> None:
        result = met(making.BUNNY_SMALL, 8_000, frames=24, gop=6, **PART)
        *others, last = (gop.qscale or 0.0 for gop in result.gop_stats)
        assert len(others) == 3
        assert max(others) < 1.5 * min(others)
        assert 0.4 < last / np.mean(others) < 2.5

    def test_resumed_without_another_first_pass(self, tmp_path: Path) -> None:
        target = tmp_path / "a.gsvr"
        options: dict[str, Any] = {"frames": 18, "gop": 6, "keyint": 0.5, "target_size": 5_000}
        options |= {"preset": "fastest", "workers": 1, **PART}
        whole = gsvrcodec.encode(making.BUNNY_SMALL, None, **options).data
        phases: list[str] = []

        class Stop(Exception):
            pass

        def watch(state: Progress) -> None:
            phases.append(state.phase)
            if state.phase == "fitting" and state.gop == 2 and "measuring" in phases:
                raise Stop

        with pytest.raises(Stop):
            gsvrcodec.encode(making.BUNNY_SMALL, target, progress=watch, **options)
        assert list(dict.fromkeys(phases)) == ["analysing", "measuring", "fitting"]
        phases.clear()
        gsvrcodec.encode(making.BUNNY_SMALL, target, progress=watch, resume=True, **options)
        assert "measuring" not in phases
        assert target.read_bytes() == whole

    def test_workers_do_not_matter(self) -> None:
        options: dict[str, Any] = {"frames": 18, "gop": 6, "keyint": 0.5, **PART}
        one, two = (
            met(making.BUNNY_SMALL, 8_000, workers=workers, **options).data for workers in (1, 2)
        )
        assert one == two
