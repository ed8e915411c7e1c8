"""Where the GOPs of an encode go: to a file when all are there, to a pipe one after another."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Protocol

from gsvrcodec.bitstream.writer import GsvrWriter
from gsvrcodec.encoder.checkpoint import Checkpoint
from gsvrcodec.errors import UsageError
from gsvrcodec.files import check_output, gathered_output, is_stream, named

#: A path of a file, a pipe or a device, "-" = the standard output; or a binary file object.
Target = Path | BinaryIO


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


class Output(Protocol):
    """The output of an encode."""

    def write_finished(self) -> None:
        """Write the GOPs that are finished, as far as the output takes them now."""

    def finish(self) -> GsvrWriter:
        """Write all that is left; return the writer, closed."""


def checked_target(
    where: str | os.PathLike[str] | BinaryIO | None,
    *,
    overwrite: bool,
    source: str | os.PathLike[str] | None,
) -> Target:
    """Return where to write if it may be written; None = a new file in memory.

    Raises:
        OutputError: As `gsvrcodec.files.check_output`.
        UsageError: It is neither a path nor an open, writable binary file object.
    """
    if where is None:
        return io.BytesIO()
    if isinstance(where, str | os.PathLike):
        return check_output(where, overwrite=overwrite, source=source)
    if isinstance(where, io.TextIOBase) or not hasattr(where, "write"):
        raise UsageError(
            f"`dst` must be a path, a binary file object or None, not {type(where).__name__}"
        )
    if getattr(where, "closed", False) or not getattr(where, "writable", lambda: True)():
        raise UsageError("the file object `dst` is closed or not open for writing")
    return where


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
            output = _LiveOutput(to, to.begin(file, stream=True))
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
                writer = self.to.begin(file, stream=False)
                for gop in self.to.gops:
                    writer.add_gop(self.to.checkpoint.payload(gop))
                writer.close()
            if self.to.check is not None:
                self.to.check(path)
        return writer


@dataclass(frozen=True, slots=True)
class _LiveOutput:
    """A pipe or a device, which gets each GOP as soon as those before it are finished."""

    to: Destination
    writer: GsvrWriter

    def write_finished(self) -> None:
        """Write up to the first GOP that is not finished."""
        with named(self.to.target):
            for gop in self.to.gops[len(self.writer.gops) :]:
                if gop not in self.to.checkpoint:
                    break
                self.writer.add_gop(self.to.checkpoint.payload(gop))

    def finish(self) -> GsvrWriter:
        """Write the rest, the index and the end."""
        self.write_finished()
        with named(self.to.target):
            self.writer.close()
        return self.writer


def _seekable(file: BinaryIO) -> bool:
    """Return whether a file object can seek; one that does not say so cannot."""
    return bool(getattr(file, "seekable", lambda: False)())
