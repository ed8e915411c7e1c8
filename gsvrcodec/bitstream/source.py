"""Random-access reading of bytes from files, bytes, URLs and pipes; safe from several threads."""

from __future__ import annotations

import io
import os
import sys
import tempfile
from pathlib import Path
from threading import Lock
from typing import BinaryIO, cast

from gsvrcodec.errors import InputError

#: What a file can be read from: a path, "-" = the standard input, a URL, bytes, or a binary file
#: object, which stays open.
Readable = str | os.PathLike[str] | bytes | BinaryIO

#: Bytes that are taken from a pipe at once, and those that are kept in memory rather than on disk.
_PIECE_BYTES = 2**20
_MEMORY_BYTES = 2**26


def open_source(where: Readable) -> Source:
    """Open what a file can be read from.

    Raises:
        InputError: It is missing, a directory, or cannot be read.
    """
    if isinstance(where, bytes):
        return Source(io.BytesIO(where), "<bytes>")
    if not isinstance(where, str | os.PathLike):
        return _of_file(where, str(getattr(where, "name", "<stream>")), owned=False)
    name = os.fspath(where)
    if name == "-":
        return _of_file(sys.stdin.buffer, "the standard input", owned=False)
    if is_url(name):
        return _open_url(name)
    try:
        return _of_file(Path(name).open("rb"), name, owned=True)
    except OSError as error:
        raise InputError(f"{name}: {_reason(error)}") from error


def is_url(name: str) -> bool:
    """Whether a name is a URL, such as https://host/film.gsvr or s3://bucket/film.gsvr."""
    return "://" in name


def path_of(where: Readable) -> str | None:
    """The path that `where` is; None = it is something else."""
    if not isinstance(where, str | os.PathLike):
        return None
    name = os.fspath(where)
    return None if name == "-" or is_url(name) else name


class Source:
    """A seekable file.

    Args:
        file: The file, at any position.
        name: For messages.
        owned: Whether `close` closes the file.

    Raises:
        InputError: The file cannot be read.
    """

    def __init__(self, file: BinaryIO, name: str, *, owned: bool = True) -> None:
        self.name = name
        self._file = file
        self._owned = owned
        self._lock = Lock()
        try:
            self._size = file.seek(0, io.SEEK_END)
        except OSError as error:
            self.close()
            raise InputError(f"{name}: {_reason(error)}") from error

    #: Whether the bytes come one after another and may still be on their way.
    arriving = False

    @property
    def size(self) -> int:
        """Bytes of the whole file; of a pipe, waits for its end."""
        return self._size

    def reaches(self, end: int) -> bool:
        """Whether the file has `end` bytes; of a pipe, waits for so many."""
        return end <= self._size

    def read(self, offset: int, size: int) -> bytes:
        """Exactly `size` bytes from byte `offset`.

        Raises:
            InputError: The file cannot be read, or became shorter since it was opened.
        """
        data = self.read_some(offset, size)
        if len(data) != size:
            raise InputError(f"{self.name}: became shorter while it was read")
        return data

    def read_some(self, offset: int, size: int) -> bytes:
        """Up to `size` bytes from byte `offset`; fewer at the end of the file.

        Raises:
            InputError: The file cannot be read.
        """
        try:
            with self._lock:
                self._file.seek(offset)
                return self._file.read(size)
        except OSError as error:
            raise InputError(f"{self.name}: {_reason(error)}") from error

    def close(self) -> None:
        """Close the file if it is owned."""
        if self._owned:
            self._file.close()


class _Remote(Source):
    """A file behind a URL."""

    def read_some(self, offset: int, size: int) -> bytes:
        """Up to `size` bytes from byte `offset`; fewer at the end of the file."""
        try:
            return super().read_some(offset, size)
        except InputError:
            raise
        except Exception as error:  # each library has its own, and few are OSErrors
            raise InputError(f"{self.name}: {_reason(error)}") from error


class Pipe(Source):
    """A file that can be read once, front to back; what came stays in a temporary file.

    Args:
        pipe: The file.
        name: For messages.
        owned: Whether `close` closes the pipe.
    """

    arriving = True

    def __init__(self, pipe: BinaryIO, name: str, *, owned: bool) -> None:
        came = tempfile.SpooledTemporaryFile(_MEMORY_BYTES)  # noqa: SIM115, closed by close()
        super().__init__(cast(BinaryIO, came), name)
        self._pipe = pipe
        self._pipe_owned = owned

    @property
    def size(self) -> int:
        """Bytes of the whole file; waits for its end."""
        while self.reaches(self._size + 1):
            pass
        return self._size

    def reaches(self, end: int) -> bool:
        """Whether the pipe has `end` bytes; waits for so many."""
        while self._size < end and self.arriving:
            with self._lock:
                self._take()
        return end <= self._size

    def read_some(self, offset: int, size: int) -> bytes:
        """Up to `size` bytes from byte `offset`; fewer at the end; waits for them."""
        self.reaches(offset + size)
        return super().read_some(offset, size)

    def close(self) -> None:
        """Drop what came; close the pipe if it is owned."""
        super().close()
        if self._pipe_owned:
            self._pipe.close()

    def _take(self) -> None:
        """Take what is there, or wait for something."""
        try:
            # `read` of a buffered file waits until it has all that it is asked for.
            data = getattr(self._pipe, "read1", self._pipe.read)(_PIECE_BYTES)
        except Exception as error:  # as in `_Remote`
            raise InputError(f"{self.name}: {_reason(error)}") from error
        self.arriving = bool(data)
        self._file.seek(self._size)
        self._size += self._file.write(data)


def _of_file(file: BinaryIO, name: str, *, owned: bool) -> Source:
    return (Source if file.seekable() else Pipe)(file, name, owned=owned)


def _open_url(url: str) -> Source:
    """Open a URL by fsspec, without reading ahead; front to back where a server gives no ranges.

    Raises:
        InputError: The URL cannot be opened, or what it takes is not installed.
    """
    try:
        from fsspec.core import url_to_fs
    except ImportError as error:
        raise InputError(f"{url}: URLs need fsspec: pip install 'fsspec[http]'") from error
    try:
        system, path = url_to_fs(url)
        file = cast(BinaryIO, system.open(path, "rb", cache_type="none"))
        try:
            file.seek(1)
            file.read(1)
        except ValueError:
            return Pipe(cast(BinaryIO, system.open(path, "rb", block_size=0)), url, owned=True)
        return _Remote(file, url)
    except FileNotFoundError as error:
        cause = error.__cause__  # fsspec says so of every failure of HTTP
        reason = str(cause) if isinstance(cause, OSError) else "no such file"
        raise InputError(f"{url}: {reason}") from error
    except Exception as error:  # each library has its own, and few are OSErrors
        raise InputError(f"{url}: {_reason(error)}") from error


def _reason(error: Exception) -> str:
    if isinstance(error, IsADirectoryError):
        return "is a directory"
    if isinstance(error, FileNotFoundError):
        return "no such file"
    return getattr(error, "strerror", None) or str(error) or type(error).__name__
