"""How far an encode has come."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from gsvrcodec.encoder.checkpoint import Checkpoint


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


class Meter:
    """Reports how far an encode has come.

    Args:
        gops: frames of each GOP.
        checkpoint: keeps those that are done.
        began: `time.perf_counter` when the encode did.
        progress: called by `report`; None = nobody wants to know.
    """

    def __init__(
        self,
        gops: Sequence[range],
        checkpoint: Checkpoint,
        began: float,
        progress: Callable[[Progress], None] | None,
    ) -> None:
        self._gops, self._checkpoint = gops, checkpoint
        self._began, self._progress = began, progress
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
            )
        )

    def _done(self) -> list[range]:
        return [gop for gop in self._gops if gop in self._checkpoint]
