"""Random-access reading of bytes, safe from several threads."""

from __future__ import annotations

import io
import os
from pathlib import Path
from threading import Lock
from typing import BinaryIO

from gsvrcodec.errors import InputError


class Source:
    """A file or a seekable stream of known size.

    Args:
        source: Path, or a binary stream, which `close` leaves open.

    Raises:
        InputError: The file is missing, a directory, not readable, or not seekable.
    """

    def __init__(self, source: str | os.PathLike[str] | BinaryIO):
        self._owned = isinstance(source, str | os.PathLike)
        self._lock = Lock()
        if isinstance(source, str | os.PathLike):
            self.name = os.fspath(source)
            try:
                self._file: BinaryIO = Path(source).open("rb")  # noqa: SIM115, closed by close()
            except OSError as error:
                raise InputError(f"{self.name}: {_reason(error)}") from error
        else:
            self.name = str(getattr(source, "name", "<stream>"))
            self._file = source
        try:
            self.size = self._file.seek(0, io.SEEK_END)
        except OSError as error:
            self.close()
            raise InputError(f"{self.name}: not seekable, copy it to a file first") from error

    def read(self, offset: int, size: int) -> bytes:
        """Exactly `size` bytes from byte `offset`.

        Raises:
            InputError: The file cannot be read, or became shorter since it was opened.
        """
        try:
            with self._lock:
                self._file.seek(offset)
                data = self._file.read(size)
        except OSError as error:
            raise InputError(f"{self.name}: {_reason(error)}") from error
        if len(data) != size:
            raise InputError(f"{self.name}: became shorter while it was read")
        return data

    def close(self) -> None:
        """Close the file if `source` was a path."""
        if self._owned:
            self._file.close()


def _reason(error: OSError) -> str:
    if isinstance(error, IsADirectoryError):
        return "is a directory"
    if isinstance(error, FileNotFoundError):
        return "no such file"
    return error.strerror or str(error)
