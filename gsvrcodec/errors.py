"""Exception classes, one a cause, each with the exit code of the command line."""

from __future__ import annotations

from contextlib import ContextDecorator
from typing import ClassVar


class GsvrError(Exception):
    """Base class of all errors that gsvrcodec raises on purpose."""

    exit_code: ClassVar[int] = 1


class InputError(GsvrError, OSError):
    """The input is missing, a directory, unreadable, or shrank while it was read."""


class OutputError(GsvrError, OSError):
    """The output exists, is the input, or cannot be written."""


class AddressError(GsvrError, OSError):
    """The server cannot listen: its port is taken, or its address not one of this machine's."""


class WorkerError(GsvrError, RuntimeError):
    """A worker process of the encoder died."""


class ClusterError(GsvrError, ConnectionError):
    """A cluster cannot be reached, was lost, or its workers do not fit this version."""


class DeviceError(GsvrError, RuntimeError):
    """The requested GPU is not usable, or its memory does not suffice."""


class VerificationError(GsvrError, ValueError):
    """The written file does not decode to the encoded pictures."""

    exit_code: ClassVar[int] = 6


class UsageError(GsvrError, ValueError):
    """Arguments that contradict each other or do not fit the input."""

    exit_code: ClassVar[int] = 2


class NotAVideoError(GsvrError, ValueError):
    """The input has no video stream, no frame in it, or, a directory, no film."""

    exit_code: ClassVar[int] = 3


class CorruptError(GsvrError, ValueError):
    """A .gsvr file breaks the rules of its format.

    Args:
        message: What is wrong, one sentence without a full stop.
        chunk: Type of the chunk that breaks the rule; None = not known.
        offset: Byte offset of that chunk in the file; None = not known.
        section: Section of the spec that has the rule, such as "5.1"; None = not known.
    """

    exit_code: ClassVar[int] = 3

    def __init__(
        self,
        message: str,
        *,
        chunk: str | None = None,
        offset: int | None = None,
        section: str | None = None,
    ):
        self.message = message
        self.chunk = chunk
        self.offset = offset
        self.section = section
        place = f"chunk {chunk}" if chunk is not None else ""
        if offset is not None:
            place += f"{' ' if place else ''}at byte {offset}"
        super().__init__(f"{place}: {message}" if place else message)

    def located(self, chunk: str, offset: int) -> CorruptError:
        """Return the same error, with `chunk` and `offset` where they were not known."""
        return type(self)(
            self.message,
            chunk=chunk if self.chunk is None else self.chunk,
            offset=offset if self.offset is None else self.offset,
            section=self.section,
        )


class spec_section(ContextDecorator):
    """Add the section of the spec to a `CorruptError` that has none; also a decorator."""

    def __init__(self, number: str) -> None:
        self._number = number

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if isinstance(error, CorruptError):
            error.section = error.section or self._number


class NotGsvrError(CorruptError):
    """The file does not start with the signature of a .gsvr file."""


class UnsupportedError(GsvrError, ValueError):
    """A valid file needs a feature that this version does not have."""

    exit_code: ClassVar[int] = 4


class LimitError(UnsupportedError):
    """A file is over the decoder's limits; see `gsvrcodec.limits.Limits`."""
