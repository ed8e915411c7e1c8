"""How far an encode has come."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from gsvrcodec.encoder.checkpoint import Checkpoint
from gsvrcodec.encoder.slicing import Chain


@dataclass(frozen=True, slots=True)
class Progress:
    """State of an encode after a GOP, or before the first (`gop` 0)."""

    gop: int  #: GOPs done
    gops: int  #: GOPs in all
    frames_done: int
    frames: int  #: in all
    psnr: float | None  #: dB, mean of the frames done; None = none yet
    seconds_per_frame: float | None  #: wall time so far over frames done in it
    eta_seconds: float | None  #: wall time still to go
    chains_done: int = 0  #: chains of GOPs of which all are done
    chains: int = 0  #: in all
    workers: int = 1  #: chains that can be fitted at the same time, now


class Meter:
    """Reports how far an encode has come.

    Args:
        gops: frames of each GOP.
        checkpoint: keeps those that are done.
        began: `time.perf_counter` when the encode did.
        progress: called by `report`; None = nobody wants to know.
        chains: of the GOPs; None = not told.
        workers: tells how many chains can be fitted at the same time now.
    """

    def __init__(
        self,
        gops: Sequence[range],
        checkpoint: Checkpoint,
        began: float,
        progress: Callable[[Progress], None] | None,
        *,
        chains: Sequence[Chain] = (),
        workers: Callable[[], int] = lambda: 1,
    ) -> None:
        self._gops, self._checkpoint = gops, checkpoint
        self._began, self._progress = began, progress
        self._chains, self._workers = chains, workers
        self._resumed = sum(map(len, self._done()))

    def report(self) -> None:
        """Call back."""
        if self._progress is None:
            return
        done = self._done()
        frames, frames_done = self._gops[-1].stop, sum(map(len, done))
        pace = None
        if frames_done > self._resumed:
            pace = (time.perf_counter() - self._began) / (frames_done - self._resumed)
        total = sum(self._checkpoint.figures(gop).psnr * len(gop) for gop in done)
        self._progress(
            Progress(
                gop=len(done),
                gops=len(self._gops),
                frames_done=frames_done,
                frames=frames,
                psnr=total / frames_done if done else None,
                seconds_per_frame=pace,
                eta_seconds=None if pace is None else pace * (frames - frames_done),
                chains_done=sum(
                    all(gop in self._checkpoint for gop in chain) for chain in self._chains
                ),
                chains=len(self._chains),
                workers=self._workers(),
            )
        )

    def _done(self) -> list[range]:
        return [gop for gop in self._gops if gop in self._checkpoint]
