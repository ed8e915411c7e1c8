"""Writing of decoded frames: a table of writers, chosen by file name or by `muxer`."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol

import av

from gsvrcodec.errors import OutputError, UsageError
from gsvrcodec.files import atomic_output, check_output
from gsvrcodec.video.colour import AnyRgb
from gsvrcodec.video.encoded import Ffv1Writer, Mp4Writer
from gsvrcodec.video.output import OutputInfo
from gsvrcodec.video.plain import Md5Writer, NullWriter, PngWriter, Y4mWriter, png_paths

#: Name of the standard output.
STDOUT = "-"


class Writer(Protocol):
    """Writes frames in presentation order."""

    def write(self, rgb: AnyRgb, pts: int, duration: int) -> None:
        """Add a (H, W, 3) picture, shown at `pts` for `duration` ticks."""

    def close(self) -> None:
        """Finish the file."""

    def abort(self) -> None:
        """Close the file without finishing it."""


#: Writers by name; each takes the path to write, None = standard output.
MUXERS: dict[str, Callable[[Path | None, OutputInfo], Writer]] = {
    "mp4": Mp4Writer,
    "mkv": Ffv1Writer,
    "y4m": Y4mWriter,
    "png": PngWriter,
    "md5": Md5Writer,
    "null": NullWriter,
}

#: Writers that also take sound, subtitles, titles and chapters.
WITH_STREAMS = frozenset({"mp4", "mkv"})

#: Writers that default to 10 bits for sources of more than 8 bits.
DEEP = frozenset({"mp4", "mkv", "y4m"})

#: Writers that can write to the standard output.
_STREAMED = frozenset({"y4m", "mkv", "md5", "null"})


def muxer_of(path: str | os.PathLike[str] | None, muxer: str | None = None) -> str:
    """Return the name of the writer for an output.

    Raises:
        UsageError: No writer fits the name, or the writer needs a file.
    """
    name = STDOUT if path is None else os.fspath(path)
    if muxer is None:
        muxer = "y4m" if name == STDOUT else Path(name).suffix.lower().removeprefix(".")
        if muxer not in MUXERS or muxer == "null":
            raise UsageError(f"{name}: use a name in .mp4, .mkv, .y4m or .png, or choose a muxer")
    if muxer not in MUXERS:
        raise UsageError(f"unknown muxer {muxer!r}; choose from {', '.join(MUXERS)}")
    if name == STDOUT and muxer not in _STREAMED:
        raise UsageError(
            f"{muxer} cannot be written to the standard output; name a file, or choose y4m or mkv"
        )
    return muxer


@contextmanager
def open_writer(
    path: str | os.PathLike[str] | None,
    info: OutputInfo,
    *,
    muxer: str | None = None,
    overwrite: bool = False,
    source: str | os.PathLike[str] | None = None,
) -> Iterator[Writer]:
    """Open an output for writing; the file appears under its name when the block succeeds.

    Args:
        path: .mp4 (H.264, or HEVC for 10 bits), .mkv (FFV1), .y4m or a numbered `name_%04d.png`;
            None or "-" = standard output.
        info: Properties of the pictures.
        muxer: One of `MUXERS`; None = by the suffix of `path`, y4m on standard output.
        overwrite: Replace existing files.
        source: The decoded file, which must not be the output.

    Raises:
        UsageError: Name and muxer do not fit together.
        OutputError: The output exists or cannot be written.
    """
    muxer = muxer_of(path, muxer)
    create = MUXERS[muxer]
    if path is None or os.fspath(path) == STDOUT or muxer == "null":
        with _finished(create(None, info)) as writer:
            yield writer
    elif muxer == "png":
        for picture in png_paths(Path(path), info):
            check_output(picture, overwrite=overwrite, source=source)
        with _finished(create(Path(path), info)) as writer:
            yield writer
    else:
        check_output(path, overwrite=overwrite, source=source)
        with (
            atomic_output(path, overwrite=overwrite) as partial,
            _finished(create(partial, info)) as writer,
        ):
            yield writer


@contextmanager
def _finished(writer: Writer) -> Iterator[Writer]:
    """Close the writer after the block, or abort it when the block fails."""
    try:
        yield writer
        writer.close()
    except av.FFmpegError as error:
        writer.abort()
        if isinstance(error, OSError):
            raise
        raise OutputError(f"the output cannot be coded: {error.strerror}") from error
    except BaseException:
        writer.abort()
        raise
