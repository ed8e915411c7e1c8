"""Checks of paths, and atomic output: a file appears complete or not at all."""

from __future__ import annotations

import hashlib
import os
import re
import secrets
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

from gsvrcodec.errors import GsvrError, InputError, OutputError

#: Bytes at the start and at the end of a file that go into its fingerprint.
_DIGESTED_BYTES = 2**20


def check_input(path: str | os.PathLike[str]) -> Path:
    """Return `path` if the file can be opened; raise `InputError` if not."""
    if re.match(r"[a-z]{2,}://", os.fspath(path)):
        raise InputError(f"{path} is a URL: download it, or pipe it in (curl URL | ... -)")
    path = Path(path)
    if path.is_dir():
        raise InputError(f"{path} is a directory, not a file")
    try:
        with path.open("rb"):
            return path
    except FileNotFoundError:
        raise InputError(f"{path} does not exist") from None
    except (OSError, ValueError) as error:
        raise InputError(f"{path} cannot be read: {_reason(error)}") from error


def check_output(
    path: str | os.PathLike[str],
    *,
    overwrite: bool = False,
    source: str | os.PathLike[str] | None = None,
) -> Path:
    """Return `path` if it may be written; "-", the standard output, always may.

    Raises:
        OutputError: `path` is a directory, its directory is missing, it exists and `overwrite` is
            not set, or it is the same file as `source`, also through links.
    """
    path = Path(path)
    if str(path) == "-":
        return path
    try:
        if source is not None and path.exists() and path.samefile(source):
            raise OutputError(f"{path} is the input itself; choose another output")
        if path.is_dir():
            raise OutputError(f"{path} is a directory; name a file in it")
        if not path.resolve().parent.is_dir():
            raise OutputError(f"{path.parent} is not a directory; create it first")
        if not overwrite and path.is_file():
            raise OutputError(f"{path} exists already; use `overwrite=True` to replace it")
    except (OSError, ValueError) as error:
        if isinstance(error, OutputError):
            raise
        raise OutputError(f"{path} cannot be written: {_reason(error)}") from error
    return path


@contextmanager
def atomic_output(path: str | os.PathLike[str], *, overwrite: bool = False) -> Iterator[Path]:
    """Yield a temporary path beside `path`; flush and rename it to `path` if the block succeeds.

    The block writes the file at the temporary path. If the block fails, the temporary file is
    removed and `path` is unchanged. A device or a pipe is written directly.

    Raises:
        OutputError: As `check_output`, and for every failure of the file system.
    """
    path = check_output(path, overwrite=overwrite)
    if path.exists() and not path.is_file():
        with named(path):
            yield path
        return
    target = path.resolve()  # write through a link, do not replace the link
    partial = target.with_name(f".{target.name}.{secrets.token_hex(4)}.part")
    with named(path):
        try:
            with partial.open("xb"):
                pass
            yield partial
            _flush(partial)
            check_output(path, overwrite=overwrite)  # another process may have created it meanwhile
            partial.replace(target)
            _flush(target.parent)
        finally:
            with suppress(OSError):
                partial.unlink(missing_ok=True)


def remove_partials(path: Path) -> None:
    """Remove the temporary files that killed processes left beside `path`."""
    name = re.compile(rf"\.{re.escape(path.name)}\.[0-9a-f]{{8}}\.part")
    for each in path.parent.iterdir():
        if name.fullmatch(each.name):
            with suppress(OSError):
                each.unlink()


@contextmanager
def gathered_output(
    path: str | os.PathLike[str] | BinaryIO, *, overwrite: bool = False
) -> Iterator[Path]:
    """As `atomic_output`, but a pipe, a device or "-" is written only when the block succeeds.

    "-" is the standard output. A binary file object is written where it stands, and stays open.
    """
    if isinstance(path, str | os.PathLike) and not is_stream(path):
        with atomic_output(path, overwrite=overwrite) as partial:
            yield partial
        return
    with tempfile.TemporaryDirectory() as directory:
        gathered = Path(directory) / "gathered"
        yield gathered
        with gathered.open("rb") as file, named(path):
            if not isinstance(path, str | os.PathLike):
                shutil.copyfileobj(file, path)
            elif os.fspath(path) == "-":
                shutil.copyfileobj(file, sys.stdout.buffer)
                sys.stdout.buffer.flush()
            else:
                with Path(path).open("wb") as output:
                    shutil.copyfileobj(file, output)


def is_stream(path: str | os.PathLike[str]) -> bool:
    """Return whether a path is "-", the standard input or output, a pipe or a device."""
    path = Path(path)
    return str(path) == "-" or (path.exists() and not path.is_file() and not path.is_dir())


def fingerprint(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Return a fingerprint of a file or of a numbered sequence such as `frame_%04d.png`.

    The fingerprint holds the number, size and modification time of the files, and a SHA-256 of the
    first and last MiB of each. It is an empty dictionary for a missing file and for an input that
    can be read only once.

    Raises:
        InputError: A file cannot be read.
    """
    path = Path(path)
    files = [path] if path.is_file() else _sequence(path)
    digest = hashlib.sha256()
    total = modified = 0
    try:
        for each in files:
            with each.open("rb") as file:
                status = os.fstat(file.fileno())
                digest.update(file.read(_DIGESTED_BYTES))
                file.seek(max(file.tell(), status.st_size - _DIGESTED_BYTES))
                digest.update(file.read(_DIGESTED_BYTES))
            total += status.st_size
            modified = max(modified, status.st_mtime_ns)
    except OSError as error:
        raise InputError(f"{path} cannot be read: {_reason(error)}") from error
    if not files:
        return {}
    return {
        "input_files": len(files),
        "input_bytes": total,
        "input_modified_ns": modified,
        "input_sha256": digest.hexdigest(),
    }


def _sequence(path: Path) -> list[Path]:
    """Return the files of a numbered sequence, sorted by name."""
    parts = re.split(r"%\d*d", path.name)
    if len(parts) != 2 or not path.parent.is_dir():
        return []
    pattern = re.compile(re.escape(parts[0]) + r"\d+" + re.escape(parts[1]))
    return sorted(each for each in path.parent.iterdir() if pattern.fullmatch(each.name))


def lock(path: Path) -> BinaryIO:
    """Open a file for reading and writing, created if missing, and lock it.

    Raises:
        OutputError: Another process has locked the file.
        OSError: The file cannot be opened.
    """
    while True:
        file = os.fdopen(os.open(path, os.O_RDWR | os.O_CREAT, 0o666), "r+b")
        if not _locked(file):
            file.close()
            raise OutputError(
                f"{path} is in use by another process; wait for it, or name another output"
            )
        # The last owner of the lock may have removed the file before it was locked here.
        with suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(file.fileno()), path.stat()):
                return file
        file.close()


def _locked(file: BinaryIO) -> bool:
    """Lock a file until it is closed or the process ends; False = another process has the lock."""
    try:
        import fcntl
    except ImportError:  # a system without such locks
        return True
    try:
        fcntl.flock(file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # a file system without locks
        pass
    return True


@contextmanager
def named(path: str | os.PathLike[str] | BinaryIO) -> Iterator[None]:
    """Turn an `OSError` of the block into an `OutputError` that names `path` or a file object."""
    try:
        yield
    except OSError as error:
        if isinstance(error, GsvrError | BrokenPipeError):
            raise
        if not isinstance(path, str | os.PathLike):
            path = str(getattr(path, "name", "the file object"))
        raise OutputError(f"{path} cannot be written: {_reason(error)}") from error


@contextmanager
def spooling() -> Iterator[None]:
    """Turn an `OSError` of the block, which copies an input, into an `OutputError`."""
    try:
        yield
    except OSError as error:
        raise OutputError(
            f"the input cannot be copied to {tempfile.gettempdir()}: {_reason(error)}; "
            "TMPDIR names another directory"
        ) from error


def _flush(path: Path) -> None:
    """Ask the operating system to put a file or a directory on the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _reason(error: Exception) -> str:
    """Return what went wrong, without the error number."""
    return (getattr(error, "strerror", None) or str(error)).lower()
