"""Inputs that can be read only once, spooled to a temporary file."""

from __future__ import annotations

import os
import shutil
import stat
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from gsvrcodec.errors import NotAVideoError, OutputError

#: Name of the standard input.
STDIN = "-"

_BLOCK_BYTES = 2**20


@contextmanager
def rereadable(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a path that can be read more than once.

    A file is its own path. A pipe or the standard input, "-", is copied to a temporary file, which
    is removed after the block.

    Raises:
        NotAVideoError: The pipe was empty.
        OutputError: The temporary file cannot be written.
    """
    name = os.fspath(path)
    if not is_pipe(name):
        yield Path(path)
        return
    with tempfile.NamedTemporaryFile(prefix="gsvr-input-") as copy:
        try:
            if name == STDIN:
                shutil.copyfileobj(sys.stdin.buffer, copy, _BLOCK_BYTES)
            else:
                with Path(name).open("rb") as pipe:
                    shutil.copyfileobj(pipe, copy, _BLOCK_BYTES)
            copy.flush()
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise OutputError(
                f"the input cannot be copied to {tempfile.gettempdir()}: {reason}; "
                "TMPDIR names another directory"
            ) from error
        if not copy.tell():
            raise NotAVideoError("nothing came through the pipe")
        yield Path(copy.name)


def is_pipe(name: str) -> bool:
    """Return whether a path is "-" or a named pipe, as of a shell's <(command)."""
    if name == STDIN:
        return True
    try:
        return stat.S_ISFIFO(Path(name).stat().st_mode)
    except (OSError, ValueError):
        return False
