"""One exception class a cause; each carries the command line's exit status for it."""

from __future__ import annotations

from typing import ClassVar


class GsvrError(Exception):
    """Base of every error that gsvrcodec raises on purpose."""

    exit_code: ClassVar[int] = 1


class InputError(GsvrError, OSError):
    """The input is missing, a directory, unreadable, or shrank while it was read."""


class OutputError(GsvrError, OSError):
    """The output exists, is the input, or cannot be written."""


class WorkerError(GsvrError, RuntimeError):
    """A process that encoded a GOP died."""


class DeviceError(GsvrError, RuntimeError):
    """The GPU that was asked for is not usable, or its memory does not suffice."""


class VerificationError(GsvrError, ValueError):
    """What was written does not decode to what was encoded."""

    exit_code: ClassVar[int] = 6


class UsageError(GsvrError, ValueError):
    """Arguments that contradict each other or do not fit the input."""

    exit_code: ClassVar[int] = 2


class NotAVideoError(GsvrError, ValueError):
    """The input has no video stream, or no frame in it."""

    exit_code: ClassVar[int] = 3


class CorruptError(GsvrError, ValueError):
    """A .gsvr file breaks the rules of its format.

    Args:
        message: What is wrong, one sentence without a full stop.
        chunk: Type of the chunk it was found in, None = not known.
        offset: Byte offset of that chunk in the file, None = not known.
    """

    exit_code: ClassVar[int] = 3

    def __init__(self, message: str, *, chunk: str | None = None, offset: int | None = None):
        self.message = message
        self.chunk = chunk
        self.offset = offset
        place = f"chunk {chunk}" if chunk is not None else ""
        if offset is not None:
            place += f"{' ' if place else ''}at byte {offset}"
        super().__init__(f"{place}: {message}" if place else message)

    def located(self, chunk: str, offset: int) -> CorruptError:
        """The same error with what it did not say itself about its place."""
        return type(self)(
            self.message,
            chunk=chunk if self.chunk is None else self.chunk,
            offset=offset if self.offset is None else self.offset,
        )


class NotGsvrError(CorruptError):
    """The file does not start with the signature of a .gsvr file."""


class UnsupportedError(GsvrError, ValueError):
    """A well-formed file needs something that this version does not have."""

    exit_code: ClassVar[int] = 4


class LimitError(UnsupportedError):
    """A file asks for more than the decoder's limits allow; see `gsvrcodec.limits.Limits`."""
