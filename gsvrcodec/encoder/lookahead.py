"""Analysis of a film in a thread, ahead of its fits: sections, chains, GOPs as they are found."""

from __future__ import annotations

import threading
import zlib
from bisect import bisect_left
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from functools import partial
from math import ceil
from types import TracebackType
from typing import Self

import numpy as np

from gsvrcodec.ahead import ahead
from gsvrcodec.encoder.analysis import Analysis, FrameStats, analyse
from gsvrcodec.encoder.checkpoint import Checkpoint
from gsvrcodec.encoder.film import Chain, Section, divided
from gsvrcodec.encoder.film_target import Aim
from gsvrcodec.encoder.settings import EncodeSettings
from gsvrcodec.encoder.tuned import LOOKAHEAD
from gsvrcodec.fit.motion import flow_estimator
from gsvrcodec.video import Rgb, VideoReader

#: Frames that are read before they are analysed.
_READ_AHEAD = 4

#: Seconds between two signs of life while somebody waits for the analysis.
_WAKE = 0.5


def checksum(picture: Rgb) -> int:
    """Return the CRC-32 of the samples of a picture, (H, W, 3) uint8."""
    return zlib.crc32(np.ascontiguousarray(picture).data)


class Lookahead:
    """Analyses a film in a thread, section by section, and slices each section into GOPs.

    A section is a shot. A long shot is divided, so that its fit can begin before its end is known.
    Where bits or time are shared out, the whole film is one section. The attributes say what is
    known so far, and grow until the film is `complete`.

    As a context manager it ends the thread. Whoever waits for it calls `waiting` now and then.

    Args:
        video: the source.
        settings: of the encode.
        checkpoint: has the analysis, or keeps it when it is complete.
        checksums: whether to take the checksum of each picture.
    """

    def __init__(
        self,
        video: VideoReader,
        settings: EncodeSettings,
        checkpoint: Checkpoint,
        *,
        checksums: bool = False,
    ) -> None:
        self.stats: list[FrameStats] = []  #: of each frame
        self.pts: list[int] = []  #: of each frame, ticks
        self.durations: list[int] = []  #: of each frame, ticks
        self.checksums: list[int] = []  #: CRC-32 of the samples of each frame, if asked for
        self.chains: list[Chain] = []
        self.gops: list[range] = []
        self.complete = False
        self.waiting: Callable[[], None] = lambda: None
        self._video, self._settings, self._checkpoint = video, settings, checkpoint
        self._summed = checksums
        self._sections: list[Section] = []
        self._error: BaseException | None = None
        self._changed = threading.Condition()
        self._closed = False
        self._thread = threading.Thread(target=self._run, name="gsvr-lookahead", daemon=True)

    def __enter__(self) -> Self:
        """Start the thread; an analysis that was kept needs none."""
        kept = self._checkpoint.analysis
        if kept is None or len(kept.checksums) < self._summed * len(kept.stats):
            self._thread.start()
        else:
            self.pts += kept.pts
            self.durations += kept.durations
            self.checksums += kept.checksums
            self._slice(iter(kept.stats))
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End the thread after its current frame."""
        self._closed = True
        if self._thread.is_alive():
            self._thread.join()

    def sections(self) -> Iterator[Section]:
        """Yield each section as soon as its end is known; raises the errors of `VideoReader`."""
        given = 0
        while True:
            self._wait(partial(self._has_more, given))
            if given == len(self._sections):
                return
            yield self._sections[given]
            given += 1

    def until(self, enough: Callable[[list[Chain]], bool]) -> list[Chain]:
        """Wait for enough chains, or for the end of the film; return all chains known by then."""
        self._wait(lambda: enough(self.chains))
        return self.chains[:]

    def end(self) -> int:
        """Wait for the end of the film, and return it in ticks."""
        self._wait(lambda: False)
        return self.pts[-1] + self.durations[-1] if self.pts else 0

    def _has_more(self, than: int) -> bool:
        """Whether more sections are known than this number."""
        return len(self._sections) > than

    def _wait(self, met: Callable[[], bool]) -> None:
        """Wait until a condition is met or the film is complete."""
        while True:
            with self._changed:
                over = self._changed.wait_for(
                    lambda: self._error or self.complete or met(), timeout=_WAKE
                )
                if self._error is not None:
                    raise self._error
            if over:
                return
            self.waiting()

    def _run(self) -> None:
        try:
            self._slice(self._analysed())
            if not self._closed:
                pts, durations = tuple(self.pts), tuple(self.durations)
                sums = tuple(self.checksums)
                self._checkpoint.keep_analysis(Analysis(tuple(self.stats), pts, durations, sums))
        except BaseException as error:
            with self._changed:
                self._error = error
                self._changed.notify_all()

    def _analysed(self) -> Iterator[FrameStats]:
        """Analyse the source, until this is closed."""
        with closing(ahead(iter(self._video), _READ_AHEAD, "gsvr-read")) as frames:

            def pictures() -> Iterator[Rgb]:
                for frame in frames:
                    if self._closed:
                        return
                    self.pts.append(frame.pts)
                    self.durations.append(frame.duration)
                    if self._summed:
                        self.checksums.append(checksum(frame.rgb))
                    yield frame.rgb

            yield from analyse(pictures(), flow_estimator(self._settings.flow))

    def _slice(self, analysed: Iterator[FrameStats]) -> None:
        """Cut the film into sections."""
        longest, whole = self._longest_section(), self._settings.shares_out
        begin = 0
        for number, stats in enumerate(analysed):
            self.stats.append(stats)
            now = self.pts[number]
            if whole or number == begin:
                continue
            if stats.cut:
                self._add(begin, number)
                begin = number
            elif now - self.pts[begin] >= 2 * longest:
                middle = bisect_left(self.pts, self.pts[begin] + longest, begin, number)
                self._add(begin, middle)
                begin = middle
        if not self._closed:
            self._add(begin, len(self.stats), last=True)

    def _longest_section(self) -> int:
        """Duration of a section of a long shot, of whole chains, ticks."""
        keyint = self._settings.keyint
        seconds = ceil(LOOKAHEAD.seconds / keyint) * keyint if keyint else LOOKAHEAD.seconds
        return round(seconds / self._video.info.time_base)

    def _add(self, begin: int, end: int, *, last: bool = False) -> None:
        """Slice a section and publish it."""
        seconds = float(sum(self.durations[begin:end]) * self._video.info.time_base)
        found = self._divided(self.stats[begin:end], seconds) if end > begin else []
        chains = [[range(begin + gop.start, begin + gop.stop) for gop in chain] for chain in found]
        with self._changed:
            self.chains += chains
            self.gops += [gop for chain in chains for gop in chain]
            self._sections += [Section(chains, seconds)] if chains else []
            self.complete = last
            self._changed.notify_all()

    def _divided(self, stats: Sequence[FrameStats], seconds: float) -> list[Chain]:
        """Return the chains of a section of so many seconds."""
        info, target = self._video.info, self._settings.target
        size = info.width, info.height
        if isinstance(target, Aim):
            target = target.guess(stats, size, seconds)
        return divided(stats, size, self._settings.structure, target, seconds=seconds)
