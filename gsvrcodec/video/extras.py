"""Sound, subtitles, titles and chapters of a source, for the .gsvr file."""

from __future__ import annotations

import logging
import os
from collections.abc import Collection
from dataclasses import dataclass, replace
from pathlib import Path

from gsvrcodec.bitstream.chunk import OVERHEAD_BYTES
from gsvrcodec.bitstream.tags import Tags
from gsvrcodec.limits import Limits
from gsvrcodec.video.probe import opened
from gsvrcodec.video.streams import CopiedStream, copy_streams
from gsvrcodec.video.tags import source_tags
from gsvrcodec.video.timing import Span

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Extras:
    """Sound, subtitles, titles and chapters."""

    tags: Tags
    streams: tuple[CopiedStream, ...]

    @property
    def streams_bytes(self) -> int:
        """Bytes of the streams' chunks in the .gsvr file."""
        return sum(OVERHEAD_BYTES + len(stream.payload) for stream in self.streams)


def read_extras(path: str | os.PathLike[str], kinds: Collection[str], span: Span) -> Extras:
    """Read sound, subtitles, titles and chapters of a source.

    Args:
        path: Any file that FFmpeg reads.
        kinds: Streams to copy: "audio", "subtitle" or both.
        span: The part of the film to keep.

    Raises:
        InputError: The file cannot be read.
        NotAVideoError: The file has no video stream.
    """
    path = Path(path)
    with opened(path) as (container, stream):
        tags = source_tags(container, stream, span)
    streams = tuple(copy_streams(path, kinds, span))
    tags = replace(tags, streams=tuple(stream.tags for stream in streams))
    if len(tags.to_bytes()) > Limits().metadata_bytes:
        _log.warning("%s: its titles and chapters are left out, they are too long", path)
        tags = Tags(streams=tuple(replace(stream, tags={}) for stream in tags.streams))
    return Extras(tags, streams)
