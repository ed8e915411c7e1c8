"""Paths: what may be read, what may be written, and output that appears whole or not at all."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from gsvrcodec.errors import GsvrError, InputError, OutputError


def check_input(path: str | os.PathLike[str]) -> Path:
    """Return `path` if it is a file that can be opened; raise `InputError` if not."""
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
    """Return `path` if it may be written.

    Raises:
        OutputError: it is a directory, its directory is missing, it exists and `overwrite` is
            not set, or it is the same file as `source`, through links or not.
    """
    path = Path(path)
    try:
        if source is not None and path.exists() and path.samefile(source):
            raise OutputError(f"{path} is the input itself; choose another output")
        if path.is_dir():
            raise OutputError(f"{path} is a directory; name a file in it")
        if not path.resolve().parent.is_dir():
            raise OutputError(f"{path.parent} is not a directory; create it first")
        if not overwrite and path.is_file():
            raise OutputError(f"{path} exists already; use -y to overwrite it")
    except (OSError, ValueError) as error:
        if isinstance(error, OutputError):
            raise
        raise OutputError(f"{path} cannot be written: {_reason(error)}") from error
    return path


@contextmanager
def atomic_output(path: str | os.PathLike[str], *, overwrite: bool = False) -> Iterator[Path]:
    """Give a temporary name beside `path`; flush and rename it to `path` when the block succeeds.

    The block creates or rewrites the file under the temporary name. If it fails, that file is
    removed and whatever stood at `path` is untouched. A device or a pipe is written directly.

    Raises:
        OutputError: as `check_output`, and for every failure of the file system.
    """
    path = check_output(path, overwrite=overwrite)
    if path.exists() and not path.is_file():
        with _named(path):
            yield path
        return
    target = path.resolve()  # a link keeps pointing at what it pointed at
    partial = target.with_name(f".{target.name}.{secrets.token_hex(4)}.part")
    with _named(path):
        try:
            with partial.open("xb"):
                pass
            yield partial
            _flush(partial)
            check_output(path, overwrite=overwrite)  # another program may have been quicker
            partial.replace(target)
            _flush(target.parent)
        finally:
            with suppress(OSError):
                partial.unlink(missing_ok=True)


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Turn an `OSError` of the block into an `OutputError` that names `path`."""
    try:
        yield
    except OSError as error:
        if isinstance(error, GsvrError | BrokenPipeError):
            raise
        raise OutputError(f"{path} cannot be written: {_reason(error)}") from error


def _flush(path: Path) -> None:
    """Ask the operating system to put a file or a directory on the disk."""
    if os.name == "nt" and path.is_dir():
        return  # directories cannot be opened there
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _reason(error: Exception) -> str:
    """Return what went wrong, without the error number."""
    return (getattr(error, "strerror", None) or str(error)).lower()
