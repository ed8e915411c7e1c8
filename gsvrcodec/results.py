"""What an encode tells: while it runs, and when it is done."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from gsvrcodec.parts import Parts


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
    scene: int = 0  #: scenes done; they come before the GOPs
    scenes: int = 0  #: scenes in all


@dataclass(frozen=True, slots=True)
class GopStats:
    """What one GOP came to."""

    first_frame: int
    frames: int
    cut: bool  #: it starts with a new scene
    motion: float  #: sum of its motion, pixels of the analysed frame
    gaussians: int
    bytes: int  #: of its payload
    bpp: float  #: of its payload
    psnr: float  #: dB, mean over its frames, of 8-bit RGB as decoded
    float_psnr: float  #: dB, the same before quantisation
    seconds: float  #: wall time of its fit


@dataclass(frozen=True, slots=True)
class EncodeResult:
    """What an encode came to."""

    path: Path
    frames: int
    gops: int
    scenes: int
    gaussians: int  #: in all GOPs and scenes
    bytes: int  #: of the file
    bpp: float  #: bits a pixel and frame, copied streams left out
    psnr: float  #: dB, mean over frames, of 8-bit RGB as decoded
    float_psnr: float  #: dB, the same before quantisation
    seconds: float  #: wall time
    gop_stats: tuple[GopStats, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return all of it as JSON can hold it."""
        return asdict(self) | {"path": str(self.path)}


class Meter:
    """Tells how far an encode has come.

    Args:
        gops: frames of each GOP.
        scenes: how many there are.
        parts: those that are done.
        began: `time.perf_counter` when the encode did.
        progress: called by `report`; None = nobody wants to know.
    """

    def __init__(
        self,
        gops: Sequence[range],
        scenes: int,
        parts: Parts,
        began: float,
        progress: Callable[[Progress], None] | None,
    ) -> None:
        self._gops, self._scenes, self._parts = gops, scenes, parts
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
        total = sum(self._parts.facts(gop)["psnr"] * len(gop) for gop in done)
        self._progress(
            Progress(
                gop=len(done),
                gops=len(self._gops),
                scene=self._parts.scenes,
                scenes=self._scenes,
                frames_done=frames_done,
                frames=frames,
                psnr=total / frames_done if done else None,
                seconds_per_frame=pace,
                eta_seconds=None if pace is None else pace * (frames - frames_done),
            )
        )

    def _done(self) -> list[range]:
        return [gop for gop in self._gops if gop in self._parts]
