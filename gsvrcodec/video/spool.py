"""Input that can be read only once, made readable again."""

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

#: Stands for the standard input.
STDIN = "-"

_BLOCK_BYTES = 2**20


@contextmanager
def rereadable(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Give a path that can be read more than once.

    That is `path` itself if it is a file. What comes through a pipe or from the standard input,
    "-", is copied to a temporary file first, which is removed after the block.

    Raises:
        NotAVideoError: nothing came.
        OutputError: there is no room for the temporary file.
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
    """Return whether a path is "-" or a named pipe, such as a shell's <(command)."""
    if name == STDIN:
        return True
    try:
        return stat.S_ISFIFO(Path(name).stat().st_mode)
    except (OSError, ValueError):
        return False
