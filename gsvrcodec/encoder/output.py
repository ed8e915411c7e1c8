"""The output: written when it is whole, or as it goes; and whether it decodes to the source."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from statistics import fmean
from typing import BinaryIO, Protocol

import numpy as np

from gsvrcodec.bitstream.writer import GsvrWriter
from gsvrcodec.decoder.decoder import open as open_gsvr
from gsvrcodec.encoder.checkpoint import Checkpoint
from gsvrcodec.encoder.plates import PlatesOnce
from gsvrcodec.encoder.request import Target
from gsvrcodec.errors import CorruptError, VerificationError
from gsvrcodec.files import gathered_output, is_stream, named
from gsvrcodec.metrics import psnr
from gsvrcodec.video import VideoReader


class Begin(Protocol):
    """Writes all that comes before the first GOP."""

    def __call__(self, file: BinaryIO, *, stream: bool) -> GsvrWriter:
        """Begin a file, or a stream, which is written front to back."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Destination:
    """Where a .gsvr file is to be written, and what to write."""

    target: Target
    overwrite: bool  #: whether to replace a file
    begin: Begin
    gops: Sequence[range]  #: frames of each GOP, in file order
    checkpoint: Checkpoint  #: where finished GOPs are
    check: Callable[[Path], None] | None  #: raises if a whole file is not as it should be
    predicts: bool  #: whether GOPs may need others

    def opened(self, file: BinaryIO, *, stream: bool) -> PlatesOnce:
        """Begin a file, or a stream."""
        return PlatesOnce(self.begin(file, stream=stream), share=self.predicts)


class Output(Protocol):
    """The output of an encode."""

    def write_finished(self) -> None:
        """Write the GOPs that are finished, as far as the output takes them now."""

    def finish(self) -> GsvrWriter:
        """Write all that is left; return the writer, closed."""


@contextmanager
def open_output(to: Destination) -> Iterator[Output]:
    """Yield the output for a destination; a file that is to be checked is written as a whole.

    Raises:
        OutputError: It cannot be written; so do the methods of the output.
    """
    target = to.target
    live = is_stream(target) if isinstance(target, Path) else not _seekable(target)
    if to.check is not None or not live:
        yield _WholeOutput(to)
        return
    with ExitStack() as files:
        with named(target):
            if not isinstance(target, Path):
                file = target
            elif os.fspath(target) == "-":
                file = sys.stdout.buffer
            else:
                file = files.enter_context(target.open("wb"))
            output = _LiveOutput(to, to.opened(file, stream=True))
        yield output


@dataclass(frozen=True, slots=True)
class _WholeOutput:
    """A file that appears when it is whole."""

    to: Destination

    def write_finished(self) -> None:
        """Write nothing yet."""

    def finish(self) -> GsvrWriter:
        """Write the file."""
        with gathered_output(self.to.target, overwrite=self.to.overwrite) as path:
            with path.open("w+b") as file:
                gops = self.to.opened(file, stream=False)
                for gop in self.to.gops:
                    gops.add(self.to.checkpoint.payload(gop))
                gops.writer.close()
            if self.to.check is not None:
                self.to.check(path)
        return gops.writer


@dataclass(frozen=True, slots=True)
class _LiveOutput:
    """A pipe or a device, which gets each GOP as soon as those before it are finished."""

    to: Destination
    out: PlatesOnce

    def write_finished(self) -> None:
        """Write up to the first GOP that is not finished."""
        with named(self.to.target):
            for gop in self.to.gops[len(self.out.writer.gops) :]:
                if gop not in self.to.checkpoint:
                    break
                self.out.add(self.to.checkpoint.payload(gop))

    def finish(self) -> GsvrWriter:
        """Write the rest, the index and the end."""
        self.write_finished()
        with named(self.to.target):
            self.out.writer.close()
        return self.out.writer


def _seekable(file: BinaryIO) -> bool:
    """Return whether a file object can seek; one that does not say so cannot."""
    return bool(getattr(file, "seekable", lambda: False)())


#: dB by which the quality of a GOP may differ from what the encoder measured: backends may round
#: single samples differently.
_TOLERANCE = 0.01


def verify_file(
    path: str | os.PathLike[str], video: VideoReader, quality: Mapping[int, float], threads: int
) -> None:
    """Decode a file from its start to its end, and compare it with its source.

    Args:
        path: the .gsvr file.
        video: its source.
        quality: of each GOP, by its first frame: mean PSNR that the encoder measured, dB.
        threads: to render with; 0 = GSVR_THREADS or all cores.

    Raises:
        VerificationError: it cannot be decoded, a frame is missing or shown at another time, or
            the quality is another.
    """
    measured: dict[int, list[float]] = {}
    try:
        with open_gsvr(path, threads=threads) as decoder:
            for number, (shot, frame) in enumerate(zip_longest(video, decoder)):
                if shot is None or frame is None:
                    raise VerificationError(
                        f"the file and its source differ from frame {number} on"
                    )
                if (shot.pts, shot.duration) != (frame.pts, frame.duration):
                    raise VerificationError(f"frame {number} is shown at another time")
                if number in quality:
                    gop = measured.setdefault(number, [])
                gop.append(psnr(frame.data.astype(np.uint8, copy=False), shot.rgb))
    except CorruptError as error:
        raise VerificationError(f"the file cannot be decoded: {error}") from error
    for first, values in measured.items():
        if not abs(fmean(values) - quality[first]) <= _TOLERANCE:
            raise VerificationError(
                f"frames {first} to {first + len(values) - 1} decode to {fmean(values):.3f} dB, "
                f"they were encoded to {quality[first]:.3f} dB"
            )
