"""Clips of .gsvr films for training: a map-style dataset of PyTorch."""

from __future__ import annotations

import os
import weakref
from bisect import bisect_right
from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from itertools import accumulate
from typing import Any, Literal, get_args

import torch
from torch.utils.data import Dataset, get_worker_info

from gsvrcodec.decoder.decoder import Decoder
from gsvrcodec.decoder.decoder import open as open_film
from gsvrcodec.decoder.pictures import RequestedSize
from gsvrcodec.errors import UsageError
from gsvrcodec.limits import Limits

#: Treatment of a clip that reaches over the end of its film.
Policy = Literal["repeat_last", "wrap", "error"]


class ClipDataset(Dataset[Any]):
    """Clips of films, uint8 tensors of shape (frames, 3, H, W) as torchcodec and torchvision have.

    Each film is divided into clips that start `step` frames apart, as many as lie in it whole, and
    at least one; they are numbered through all films, in their order. Reading an item decodes the
    frames of the clip and no others, so that any order is as good as another.

    It works in the workers of a `DataLoader`, forked or spawned: films are opened in the process
    that reads them, where the last `open_films` of them stay open, and each worker renders with one
    thread. Not for use by several threads of one process.
    """

    def __init__(
        self,
        paths: str | os.PathLike[str] | Sequence[str | os.PathLike[str]],
        *,
        frames: int = 16,
        stride: int = 1,
        step: int | None = None,
        random: bool = False,
        size: RequestedSize | None = None,
        transform: Callable[[torch.Tensor], Any] | None = None,
        policy: Policy = "repeat_last",
        open_films: int = 8,
        limits: Limits | None = None,
    ) -> None:
        """Read how many frames each film has.

        Args:
            paths: .gsvr files, by path or URL.
            frames: frames of a clip.
            stride: frames of the film from one frame of the clip to the next, 1 = all.
            step: frames of the film from the start of one clip to that of the next; None =
                `frames` * `stride`, so that clips lie side by side.
            random: draw the start of a clip anew each time, from all of the film that clip `index`
                is of, by torch's generator of the process, which a `DataLoader` seeds in its
                workers. Otherwise an item depends on nothing but `index`.
            size: size of the pictures, as of `gsvrcodec.open`; None = as coded. Films of several
                sizes need one to be batched.
            transform: applied to each clip, a tensor that may be changed.
            policy: of the clip of a film that is too short, as torchcodec's: its last frame is
                repeated, it begins again, or an error says so at once.
            open_films: films that stay open in a process.
            limits: limits on the content, as of `gsvrcodec.open`.

        Raises:
            UsageError: a number is below 1, `policy` is unknown, there is no film, or one is too
                short.
            GsvrError: a film cannot be opened; see `gsvrcodec.open`.
        """
        self.paths = [paths] if isinstance(paths, str | os.PathLike) else list(paths)
        self.frames, self.stride = frames, stride
        self.step = frames * stride if step is None else step
        self.random, self.size, self.transform = random, size, transform
        self.policy, self.limits, self._open_films = policy, limits, open_films
        numbers = {"frames": frames, "stride": stride, "step": self.step, "open_films": open_films}
        for name, value in numbers.items():
            if value < 1:
                raise UsageError(f"`{name}` must be at least 1, not {value}")
        if policy not in get_args(Policy):
            raise UsageError(
                f"`policy` must be one of {', '.join(get_args(Policy))}, not {policy!r}"
            )
        if not self.paths:
            raise UsageError("a dataset of clips needs at least one film")
        self._lengths = list(self._counted())
        self._ends = list(
            accumulate(self._starts(film, self.step) for film in range(len(self.paths)))
        )
        self._decoders: OrderedDict[int, Decoder] = OrderedDict()
        self._process: int | None = None  # the one that they were opened in

    def __len__(self) -> int:
        """Return the number of clips."""
        return self._ends[-1]

    def __getitem__(self, index: int) -> Any:
        """Return clip `index`, transformed; raises `IndexError` if there is none."""
        film, start = self.place(index)
        if self.random:
            start = int(torch.randint(self._starts(film, 1), ()))
        stop = min(start + self.span, self._lengths[film])
        found = range(start, stop, self.stride)
        if self.policy == "wrap":
            numbers = [found[n % len(found)] for n in range(self.frames)]
        else:
            numbers = [found[min(n, len(found) - 1)] for n in range(self.frames)]
        tensor = self._decoder(film).get_frames_at(numbers).tensor
        clip = tensor.permute(0, 3, 1, 2)  # contiguous, so that a batch copies it at once
        return clip if self.transform is None else self.transform(clip)

    def place(self, index: int) -> tuple[int, int]:
        """Return where clip `index` is: number of its film, from 0, and of its first frame.

        With `random` the first frame is not what is read. Raises `IndexError` if there is none.
        """
        number = index + len(self) if index < 0 else index
        if not 0 <= number < len(self):
            raise IndexError(f"clip {index} of {len(self)}")
        film = bisect_right(self._ends, number)
        before = self._ends[film - 1] if film else 0
        return film, (number - before) * self.step

    @property
    def span(self) -> int:
        """Frames of the film from the first to the last frame of a clip, both included."""
        return (self.frames - 1) * self.stride + 1

    def __iter__(self) -> Iterator[Any]:
        """Yield all clips in order."""
        return (self[index] for index in range(len(self)))

    def close(self) -> None:
        """Close the films that are open in this process; reading opens them again."""
        _close(self._decoders, self._process)

    def __getstate__(self) -> dict[str, Any]:
        """Leave out open films, which belong to one process."""
        return {**self.__dict__, "_decoders": OrderedDict(), "_process": None, "_others": None}

    def _counted(self) -> Iterator[int]:
        """Yield the number of frames of each film."""
        for path in self.paths:
            with open_film(path, limits=self.limits) as decoder:
                length = len(decoder)
            if length < self.span and self.policy == "error":
                raise UsageError(f"{path} has {length} frames, a clip takes {self.span}")
            yield length

    def _starts(self, film: int, step: int) -> int:
        """Return how many clips start in a film, `step` frames apart."""
        return max(0, self._lengths[film] - self.span) // step + 1

    def _decoder(self, film: int) -> Decoder:
        """Return a film, opened in this process."""
        if self._process != os.getpid():
            # Films of the process that this one was forked from are kept as they are: the threads
            # that closing them would wait for are not here.
            self._others, self._decoders = self._decoders, OrderedDict()
            self._process = os.getpid()
            weakref.finalize(self, _close, self._decoders, self._process)
        found = self._decoders.pop(film, None)
        if found is None:
            found = open_film(
                self.paths[film],
                size=self.size,
                threads=0 if get_worker_info() is None else 1,
                tensors=True,
                planar=True,
                limits=self.limits,
            )
            while len(self._decoders) >= self._open_films:
                self._decoders.popitem(last=False)[1].close()
        self._decoders[film] = found
        return found


def _close(decoders: OrderedDict[int, Decoder], process: int | None) -> None:
    """Close films that were opened in this process."""
    while process == os.getpid() and decoders:
        decoders.popitem()[1].close()
