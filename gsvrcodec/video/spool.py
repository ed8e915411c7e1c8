"""Sources of an encode: files, and sources that are spooled to a temporary file first."""

from __future__ import annotations

import io
import os
import shutil
import stat
import sys
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from typing import Any, BinaryIO, cast

from av.container import InputContainer

from gsvrcodec.errors import NotAVideoError, UsageError
from gsvrcodec.files import spooling
from gsvrcodec.video.memory import write_frames
from gsvrcodec.video.timing import Part, frame_rate

#: Name of the standard input.
STDIN = "-"

#: Source of an encode: a path, "-" = the standard input; the bytes of a file, or a binary file
#: object; an input container of PyAV; or frames, see `gsvrcodec.video.memory.rgb_frames`.
VideoSource = str | os.PathLike[str] | bytes | BinaryIO | InputContainer | Iterable[Any]

_BLOCK_BYTES = 2**20


def path_of(source: VideoSource) -> str | os.PathLike[str] | None:
    """The path that a source is read from, "-" for the standard input; None = it has none."""
    if isinstance(source, InputContainer) and source.file is None:
        return source.name.removeprefix("file:")
    return source if isinstance(source, str | os.PathLike) else None


@contextmanager
def rereadable(
    source: VideoSource, *, fps: float | Fraction | str | None = None, part: Part | None = None
) -> Iterator[Path]:
    """Yield a path that can be read more than once.

    A file is its own path, and so is the file of a container. What can be read only once, or has no
    path, is copied to a temporary file, which is removed after the block: a pipe, bytes and file
    objects as they are, frames without loss. A container and a file object that can seek are left
    where they stand, and read from the start.

    Args:
        source: What to read.
        fps: Frames a second of frames from memory, for which it is needed; a string may be a
            fraction such as "30000/1001".
        part: What will be read of it; None = all.

    Raises:
        NotAVideoError: Nothing came.
        OutputError: The temporary file cannot be written.
        UsageError: The source is none of these; `fps` is missing, wrong, or has no place here; a
            frame cannot be encoded.
    """
    path = path_of(source)
    raw = path is not None or isinstance(source, bytes | InputContainer) or _is_file(source)
    if raw and fps is not None:
        raise UsageError(
            "`fps` is for frames from memory; `rate` is for pictures and raw streams in files"
        )
    if path is not None and not is_pipe(os.fspath(path)):
        if isinstance(source, InputContainer) and not Path(path).exists():
            raise UsageError(
                f"a container must be of a file, which {path} is not; "
                "its frames can be encoded, `container.decode(video=0)` with `fps`"
            )
        yield Path(path)
        return
    if not raw and not isinstance(source, Iterable):
        raise UsageError(
            "`src` must be a path, bytes, a binary file object, a container of PyAV, or frames, "
            f"not {type(source).__name__}"
        )
    if not raw and fps is None:
        raise UsageError("frames from memory need `fps`, their number a second")
    with spooling():
        copy = tempfile.NamedTemporaryFile(prefix="gsvr-input-")  # noqa: SIM115, closed below
    with copy:
        file = cast(BinaryIO, copy)
        if raw:
            with spooling():
                _copy(source, file)
                file.flush()
        else:
            assert fps is not None
            rate = frame_rate(fps, "`fps`")
            write_frames(cast(Iterable[Any], source), rate, part or Part(), Path(copy.name))
        yield Path(copy.name)


def is_pipe(name: str) -> bool:
    """Return whether a path is "-" or a named pipe, as of a shell's <(command)."""
    if name == STDIN:
        return True
    try:
        return stat.S_ISFIFO(Path(name).stat().st_mode)
    except (OSError, ValueError):
        return False


def _is_file(source: VideoSource) -> bool:
    return hasattr(source, "read")


def _copy(source: Any, copy: BinaryIO) -> None:
    """Copy the bytes of a source that has no path, or of a pipe."""
    if isinstance(source, bytes):
        copy.write(source)
    elif isinstance(source, InputContainer):
        _copy_file(cast(Any, source.file).file, copy)
    elif not isinstance(source, str | os.PathLike):
        _copy_file(source, copy)
    elif os.fspath(source) == STDIN:
        shutil.copyfileobj(sys.stdin.buffer, copy, _BLOCK_BYTES)
    else:
        with Path(source).open("rb") as pipe:
            shutil.copyfileobj(pipe, copy, _BLOCK_BYTES)
    if not copy.tell():
        raise NotAVideoError("the input is empty: nothing came")


def _copy_file(file: Any, copy: BinaryIO) -> None:
    """Copy a file object, the whole of it and without moving it if it can seek."""
    if isinstance(file, io.TextIOBase):
        raise UsageError("a file object must be binary; open it with 'rb'")
    if not file.seekable():
        shutil.copyfileobj(file, copy, _BLOCK_BYTES)
        return
    place = file.tell()
    try:
        file.seek(0)
        shutil.copyfileobj(file, copy, _BLOCK_BYTES)
    finally:
        file.seek(place)
