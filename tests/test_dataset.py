"""Clips for training, in this process and in workers."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch.utils.data import DataLoader, RandomSampler

import gsvrcodec
from gsvrcodec import ClipDataset
from gsvrcodec.errors import InputError, UsageError
from tests import making

#: Frames of each film.
LENGTHS = (12, 3, 9)

#: Python 3.12 warns of what PyTorch does by default.
pytestmark = pytest.mark.filterwarnings("ignore:.*use of fork:DeprecationWarning")


@pytest.fixture(scope="module")
def films(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("films")
    return [
        making.gsvr_file(folder / f"{n}.gsvr", frames=(2, length - 2), predicted=True)
        for n, length in enumerate(LENGTHS)
    ]


@pytest.fixture(scope="module")
def pictures(films: list[Path]) -> list[torch.Tensor]:
    """All frames of each film, (F, 3, H, W)."""
    found = []
    for film in films:
        with gsvrcodec.open(film) as decoder:
            found.append(torch.from_numpy(decoder[:].data).movedim(3, 1))
    return found


class TestClips:
    def test_lie_side_by_side(self, films: list[Path], pictures: list[torch.Tensor]) -> None:
        clips = ClipDataset(films, frames=4)
        assert len(clips) == 3 + 1 + 2
        assert [clips.place(n) for n in range(6)] == [
            (0, 0),
            (0, 4),
            (0, 8),
            (1, 0),
            (2, 0),
            (2, 4),
        ]
        assert clips[2].dtype == torch.uint8
        assert clips[2].is_contiguous()
        assert torch.equal(clips[2], pictures[0][8:12])
        assert torch.equal(clips[-1], pictures[2][4:8])
        assert len(list(clips)) == 6

    def test_overlap_and_leave_frames_out(
        self, films: list[Path], pictures: list[torch.Tensor]
    ) -> None:
        clips = ClipDataset(films[0], frames=3, stride=2, step=3)
        assert [clips.place(n) for n in range(len(clips))] == [(0, 0), (0, 3), (0, 6)]
        assert torch.equal(clips[1], pictures[0][3:9:2])

    def test_of_short_films(self, films: list[Path], pictures: list[torch.Tensor]) -> None:
        (clip,) = ClipDataset(films[1], frames=5)
        assert torch.equal(clip, pictures[1][[0, 1, 2, 2, 2]])
        (clip,) = ClipDataset(films[1], frames=5, policy="wrap")
        assert torch.equal(clip, pictures[1][[0, 1, 2, 0, 1]])
        (clip,) = ClipDataset(films[0], frames=8, stride=5, policy="repeat_last")
        assert torch.equal(clip, pictures[0][[0, 5, 10, 10, 10, 10, 10, 10]])
        with pytest.raises(UsageError, match="has 3 frames, a clip takes 5"):
            ClipDataset(films, frames=5, policy="error")

    def test_size_and_transform(self, films: list[Path]) -> None:
        clips = ClipDataset(
            films, frames=2, size=(24, 20), transform=lambda clip: clip.float() / 255
        )
        assert clips[0].shape == (2, 3, 20, 24)
        assert 0 < clips[0].max() <= 1

    def test_at_random(self, films: list[Path], pictures: list[torch.Tensor]) -> None:
        clips = ClipDataset(films[0], frames=4, random=True)
        assert len(clips) == 3
        torch.manual_seed(5)
        drawn = [clips[0] for _ in range(40)]
        starts = [
            n for clip in drawn for n in range(9) if torch.equal(clip, pictures[0][n : n + 4])
        ]
        assert len(starts) == 40
        assert set(starts) == set(range(9))
        torch.manual_seed(5)
        assert all(torch.equal(clips[0], clip) for clip in drawn)

    def test_few_films_stay_open(self, films: list[Path], pictures: list[torch.Tensor]) -> None:
        clips = ClipDataset(films, frames=3, open_films=2)
        for film in (0, 1, 2, 0, 2):
            number = next(n for n in range(len(clips)) if clips.place(n)[0] == film)
            assert torch.equal(clips[number], pictures[film][:3])
            assert len(clips._decoders) <= 2

    def test_pickled_without_open_films(self, films: list[Path]) -> None:
        clips = ClipDataset(films, frames=3)
        first = clips[0]
        copy = pickle.loads(pickle.dumps(clips))
        assert not copy._decoders
        assert torch.equal(copy[0], first)
        clips.close()
        assert not clips._decoders
        assert torch.equal(clips[0], first)

    @pytest.mark.parametrize("index", [6, -7])
    def test_out_of_range_fails(self, films: list[Path], index: int) -> None:
        with pytest.raises(IndexError, match=f"clip {index} of 6"):
            ClipDataset(films, frames=4)[index]

    @pytest.mark.parametrize("name", ["frames", "stride", "step", "open_films"])
    def test_numbers_below_1_fail(self, films: list[Path], name: str) -> None:
        numbers: dict[str, Any] = {name: 0}
        with pytest.raises(UsageError, match=f"`{name}` must be at least 1"):
            ClipDataset(films, **numbers)

    def test_what_is_no_film_fails(self, tmp_path: Path) -> None:
        with pytest.raises(UsageError, match="at least one film"):
            ClipDataset([])
        with pytest.raises(UsageError, match="one of repeat_last, wrap, error, not 'stop'"):
            ClipDataset([], policy="stop")  # type: ignore[arg-type]
        with pytest.raises(InputError, match="no such file"):
            ClipDataset(tmp_path / "none.gsvr")


def in_order(films: list[Path], workers: int, **options: Any) -> list[torch.Tensor]:
    """Return all clips, read by forked workers."""
    clips = ClipDataset(films, frames=3, **options)
    assert clips[0].any()  # a film is open when workers are forked
    method = "fork" if workers else None
    return list(DataLoader(clips, 2, num_workers=workers, multiprocessing_context=method))


class TestWorkers:
    @pytest.mark.parametrize(("workers", "method"), [(0, None), (2, "fork"), (2, "spawn")])
    def test_train(self, films: list[Path], workers: int, method: str | None) -> None:
        """A net learns to tell a frame from the two around it."""
        torch.manual_seed(0)
        clips = ClipDataset(films, frames=3, step=1, size=(24, 16))
        loader = DataLoader(
            clips,
            4,
            sampler=RandomSampler(clips, replacement=True, num_samples=96),
            num_workers=workers,
            multiprocessing_context=method,
        )
        net = torch.nn.Sequential(
            torch.nn.Conv2d(6, 16, 3, padding=1), torch.nn.ReLU(), torch.nn.Conv2d(16, 3, 1)
        )
        losses: list[float] = []
        for batch in loader:
            before, middle, after = (batch.float() / 255).unbind(1)
            loss = torch.nn.functional.mse_loss(net(torch.cat([before, after], 1)), middle)
            loss.backward()  # type: ignore[no-untyped-call]
            with torch.no_grad():  # by hand: torch.optim takes seconds to load
                for weight in net.parameters():
                    assert weight.grad is not None
                    weight.sub_(weight.grad.sign(), alpha=0.02 * 0.8 ** len(losses))
                    weight.grad = None
            losses.append(loss.item())
        assert len(losses) == 24
        assert np.mean(losses[-5:]) < 0.5 * np.mean(losses[:5])

    def test_read_the_same_clips(self, films: list[Path]) -> None:
        expected, actual = (in_order(films, workers) for workers in (0, 2))
        assert len(expected) == 4
        assert all(torch.equal(a, b) for a, b in zip(expected, actual, strict=True))

    def test_draw_by_their_seeds(self, films: list[Path]) -> None:
        drawn = []
        for seed in (1, 1, 2):
            torch.manual_seed(seed)
            drawn.append(torch.cat(in_order(films, 2, random=True, step=1)))
        assert torch.equal(drawn[0], drawn[1])
        assert not torch.equal(drawn[0], drawn[2])
