"""What an encode is asked for, checked before anything is loaded that takes long."""

from __future__ import annotations

import io
import os
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, BinaryIO

from gsvrcodec.encoder.settings import EncodeSettings
from gsvrcodec.errors import UsageError
from gsvrcodec.files import check_input, check_output, fingerprint, is_stream
from gsvrcodec.video import VideoSource, is_pipe, path_of, reading_options

#: Suffixes of outputs that a user does not mean to be .gsvr.
_FOREIGN = re.compile(
    r"\.(mp4|m4v|mov|mkv|webm|avi|mpe?g|ts|flv|wmv|ogv|h?26[45]|hevc|av1|ivf|y4m|yuv|gif|png|jpe?g|"
    r"webp|jxl|tiff?|bmp)",
    re.IGNORECASE,
)

#: A path of a file, a pipe or a device, "-" = the standard output; or a binary file object.
Target = Path | BinaryIO


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """An encode that may begin."""

    target: Target
    in_memory: bool  #: whether the target is a new file in memory
    settings: EncodeSettings
    source: Mapping[str, Any]  #: fingerprint of the source; empty = it cannot be read again
    beside: Path | None  #: output beside which a checkpoint is kept; None = there is none

    @property
    def reading(self) -> dict[str, Any]:
        """Arguments of `open_video`."""
        return reading_options(asdict(self.settings))


def checked(
    src: VideoSource,
    dst: str | os.PathLike[str] | BinaryIO | None,
    settings: EncodeSettings,
    *,
    overwrite: bool,
    resume: bool,
    executor: bool,
    shared_source: bool,
) -> Request:
    """Return the request for an encode; arguments as of `gsvrcodec.encode`.

    Args:
        src: What to encode.
        dst: Where to write.
        settings: Of the encode.
        overwrite: Whether to replace `dst`.
        resume: Whether to go on from a checkpoint.
        executor: Whether workers of an executor fit.
        shared_source: Whether they read `src` by themselves.

    Raises:
        UsageError: Two arguments contradict each other, or `dst` is nothing that can be written.
        InputError: `src` is a file that cannot be read.
        OutputError: As `gsvrcodec.files.check_output`.
    """
    name = path_of(src)
    alone = name is not None and not is_pipe(os.fspath(name))
    if isinstance(src, str | os.PathLike) and alone and "%" not in os.fspath(src):
        check_input(src)
    if shared_source and not executor:
        raise UsageError("`shared_source` is for the workers of an `executor`")
    if shared_source and not alone:
        raise UsageError("`shared_source` needs a file that workers can read, not a pipe")
    target = _checked_target(dst, overwrite=overwrite, source=name)
    source = {} if name is None else fingerprint(name)
    beside = target if source and isinstance(target, Path) and not is_stream(target) else None
    if resume and beside is None:
        raise UsageError(
            "`resume=True` needs an input that can be read again and an output on a disk"
        )
    return Request(
        target=target, in_memory=dst is None, settings=settings, source=source, beside=beside
    )


def _checked_target(
    where: str | os.PathLike[str] | BinaryIO | None,
    *,
    overwrite: bool,
    source: str | os.PathLike[str] | None,
) -> Target:
    """Return where to write if it may be written; None = a new file in memory."""
    if where is None:
        return io.BytesIO()
    if isinstance(where, str | os.PathLike):
        path = check_output(where, overwrite=overwrite, source=source)
        if _FOREIGN.fullmatch(path.suffix):
            raise UsageError(
                f"{path} is named like another format, but an encode writes .gsvr: name it "
                f"{path.with_suffix('.gsvr')}"
            )
        return path
    if isinstance(where, io.TextIOBase) or not hasattr(where, "write"):
        raise UsageError(
            f"`dst` must be a path, a binary file object or None, not {type(where).__name__}"
        )
    if getattr(where, "closed", False) or not getattr(where, "writable", lambda: True)():
        raise UsageError("the file object `dst` is closed or not open for writing")
    return where
