"""How far an encode has come."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from gsvrcodec.encoder.checkpoint import Checkpoint
from gsvrcodec.encoder.film import Chain


@dataclass(frozen=True, slots=True)
class Progress:
    """State of an encode after a GOP, or before the first (`gop` 0)."""

    gop: int  #: GOPs done
    gops: int  #: all GOPs of the frames analysed so far
    frames_done: int
    frames: int  #: all frames; until `analysed` a number by the container, or those analysed so far
    psnr: float | None  #: dB, mean of the frames done; None = none yet
    seconds_per_frame: float | None  #: wall time so far over frames done in it
    eta_seconds: float | None  #: wall time still to go; None = not known yet
    chains_done: int = 0  #: chains of GOPs of which all are done
    chains: int = 0  #: all chains of the frames analysed so far
    workers: int = 1  #: chains that can be fitted at the same time, now
    analysed: bool = True  #: whether the whole film is analysed, so that all numbers are final


class Known(Protocol):
    """The GOPs of a film, as far as they are known."""

    gops: list[range]  #: frames of each
    chains: list[Chain]
    complete: bool  #: whether these are all


class Meter:
    """Reports how far an encode has come.

    Args:
        known: has the GOPs and chains of the film that are known so far.
        checkpoint: keeps those that are done.
        began: `time.perf_counter` when the encode did.
        progress: called by `report`; None = nobody wants to know.
        expected: frames of the film, as its container tells; None = it does not.
        workers: tells how many chains can be fitted at the same time now.
    """

    def __init__(
        self,
        known: Known,
        checkpoint: Checkpoint,
        began: float,
        progress: Callable[[Progress], None] | None,
        expected: int | None = None,
        workers: Callable[[], int] = lambda: 1,
    ) -> None:
        self._known, self._checkpoint = known, checkpoint
        self._began, self._progress = began, progress
        self._expected, self._workers = expected, workers
        self._resumed = set(checkpoint)

    def report(self) -> None:
        """Call back."""
        if self._progress is None:
            return
        complete = self._known.complete  # first, because the lists grow
        gops, chains = self._known.gops[:], self._known.chains[:]
        done = [gop for gop in gops if gop in self._checkpoint]
        frames, frames_done = gops[-1].stop, sum(map(len, done))
        fitted = sum(len(gop) for gop in done if gop not in self._resumed)
        if not complete:
            frames = max(frames, self._expected or 0)
        foreseen = complete or self._expected is not None
        pace = None
        if fitted:
            pace = (time.perf_counter() - self._began) / fitted
        total = sum(self._checkpoint.figures(gop).psnr * len(gop) for gop in done)
        self._progress(
            Progress(
                gop=len(done),
                gops=len(gops),
                frames_done=frames_done,
                frames=frames,
                psnr=total / frames_done if done else None,
                seconds_per_frame=pace,
                eta_seconds=pace * (frames - frames_done) if pace and foreseen else None,
                chains_done=sum(all(gop in self._checkpoint for gop in chain) for chain in chains),
                chains=len(chains),
                workers=self._workers(),
                analysed=complete,
            )
        )
