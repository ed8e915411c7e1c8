"""How far an encode has come."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal, Protocol

from gsvrcodec.encoder.checkpoint import Checkpoint
from gsvrcodec.encoder.film import Chain

#: What an encode does: it looks for GOPs, fits them quickly to see what they take, fits them,
#: compares the file with the source.
Phase = Literal["analysing", "measuring", "fitting", "verifying"]


@dataclass(frozen=True, slots=True)
class Progress:
    """State of an encode, at any time."""

    gop: int  #: GOPs done
    gops: int  #: all GOPs of the frames analysed so far
    frames_done: int
    frames: int  #: all frames; until `analysed` a number by the container, or those analysed so far
    psnr: float | None  #: dB, mean of the frames done; None = none yet
    seconds_per_frame: float | None  #: wall time so far over frames done in it
    #: Wall time still to go: by the preset until a GOP is done; None = not known yet, as in a first
    #: pass.
    eta_seconds: float | None
    chains_done: int = 0  #: chains of GOPs of which all are done
    chains: int = 0  #: all chains of the frames analysed so far
    workers: int = 1  #: chains that can be fitted at the same time, now
    analysed: bool = True  #: whether the whole film is analysed, so that all numbers are final
    phase: Phase = "fitting"  #: what the encode does
    frames_analysed: int = 0  #: frames that the analysis has seen
    bitrate: float | None = None  #: bits a second of the GOPs done; None = none yet


class Known(Protocol):
    """The GOPs of a film, as far as they are known."""

    gops: list[range]  #: frames of each
    chains: list[Chain]
    durations: list[int]  #: of each frame analysed, ticks
    complete: bool  #: whether these are all


class Meter:
    """Reports how far an encode has come.

    Args:
        known: has the frames, GOPs and chains of the film that are known so far.
        checkpoint: keeps those GOPs that are done.
        began: `time.perf_counter` when the encode did.
        progress: called by `report`; None = nobody wants to know.
        time_base: seconds a tick.
        expected: frames of the film, as its container tells; None = it does not.
        pace: tells how many seconds a frame is expected to take, with so many workers.
    """

    def __init__(
        self,
        known: Known,
        checkpoint: Checkpoint,
        began: float,
        progress: Callable[[Progress], None] | None,
        time_base: Fraction,
        expected: int | None,
        pace: Callable[[int], float],
    ) -> None:
        self.workers: Callable[[], int] = lambda: 1  #: how many chains are fitted at once, now
        self._known, self._checkpoint = known, checkpoint
        self._began, self._progress = began, progress
        self._time_base, self._expected, self._pace = time_base, expected, pace
        self._resumed = set(checkpoint)

    def report(self, phase: Phase = "fitting") -> None:
        """Call back."""
        if self._progress is None:
            return
        known = self._known
        complete = known.complete  # first, because the lists grow
        gops, chains, durations = known.gops[:], known.chains[:], known.durations[:]
        done = [gop for gop in gops if gop in self._checkpoint]
        frames, frames_done = gops[-1].stop if gops else 0, sum(map(len, done))
        fitted = sum(len(gop) for gop in done if gop not in self._resumed)
        if not complete:
            frames = max(frames, self._expected or 0)
        foreseen = phase != "measuring" and (complete or self._expected is not None)
        workers = self.workers()
        pace = (time.perf_counter() - self._began) / fitted if fitted else None
        expected = pace or self._pace(max(1, min(workers, len(chains))))
        psnr = sum(self._checkpoint.figures(gop).psnr * len(gop) for gop in done)
        self._progress(
            Progress(
                gop=len(done),
                gops=len(gops),
                frames_done=frames_done,
                frames=frames,
                psnr=psnr / frames_done if done else None,
                seconds_per_frame=pace,
                eta_seconds=expected * (frames - frames_done) if foreseen else None,
                chains_done=sum(all(gop in self._checkpoint for gop in chain) for chain in chains),
                chains=len(chains),
                workers=workers,
                analysed=complete,
                phase=phase,
                frames_analysed=len(durations),
                bitrate=self._bitrate(done, durations),
            )
        )

    def _bitrate(self, done: Sequence[range], durations: Sequence[int]) -> float | None:
        """Return the bits a second of GOPs that are done; a plate that several have counts once."""
        seconds = self._time_base * sum(sum(durations[gop.start : gop.stop]) for gop in done)
        if not seconds:
            return None
        plates = [self._checkpoint.figures(gop).plate_bytes for gop in done]
        again = sum(plates) - sum(set(plates))  # two plates are hardly ever of the same size
        return float(8 * (sum(map(self._checkpoint.size, done)) - again) / seconds)
