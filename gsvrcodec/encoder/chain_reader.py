"""Frames of chains: read here, one chain after another, or left for workers to read."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping
from itertools import islice
from typing import Any, Protocol

import numpy as np

from gsvrcodec.encoder.chain import ChainFrames
from gsvrcodec.encoder.lookahead import Lookahead
from gsvrcodec.encoder.packed import packed
from gsvrcodec.encoder.shared import SharedPictures, SharedSource
from gsvrcodec.encoder.slicing import Chain
from gsvrcodec.errors import InputError
from gsvrcodec.video import SourceFrame, VideoReader


class ChainReader(Protocol):
    """Gets the frames of chains, in the order of the film."""

    def read(self, chain: Chain, finished: int) -> ChainFrames:
        """Return the frames of a chain; the pictures of its first `finished` GOPs are left out."""

    def skip(self, chain: Chain) -> None:
        """Pass over a chain."""


class ReadHere(ChainReader):
    """Reads the source in this process.

    Args:
        video: the source.
        pack: pack the pictures of each GOP as soon as they are read.
    """

    def __init__(self, video: VideoReader, *, pack: bool) -> None:
        self._info, self._pack = video.info, pack
        self._frames: Iterator[SourceFrame] = iter(video)

    def read(self, chain: Chain, finished: int) -> ChainFrames:
        """Read the frames of a chain; InputError if the video has become shorter."""
        info, read = self._info, ChainFrames(chain, [], [], [])
        for number, gop in enumerate(chain):
            kept = len(gop) if number >= finished else 0
            pictures = np.empty((kept, info.height, info.width, 3), np.uint8)
            times = np.empty((2, len(gop)), np.int64)
            found = 0
            for found, frame in enumerate(islice(self._frames, len(gop)), 1):
                times[:, found - 1] = frame.pts, frame.duration
                if kept:
                    pictures[found - 1] = frame.rgb
            if found < len(gop):
                raise InputError(f"{info.path} became shorter while it was read")
            read.pictures.append(packed(pictures) if self._pack else pictures)
            read.pts.append(times[0])
            read.durations.append(times[1])
        return read

    def skip(self, chain: Chain) -> None:
        """Read the frames of a chain and drop them."""
        deque(islice(self._frames, chain[-1].stop - chain[0].start), maxlen=0)


class ReadThere(ChainReader):
    """Leaves the reading to workers, which see the source at the same path.

    Args:
        video: the source, a file.
        options: with which it was opened, see `gsvrcodec.video.open_video`.
        lookahead: has timestamps and checksums of the frames.
    """

    def __init__(
        self, video: VideoReader, options: Mapping[str, Any], lookahead: Lookahead
    ) -> None:
        self._path = str(video.info.path.absolute())
        self._options, self._known = dict(options), lookahead

    def read(self, chain: Chain, finished: int) -> ChainFrames:
        """Return frames that are read where they are unpacked."""
        source, known = SharedSource(self._path, self._options), self._known
        read = ChainFrames(chain, [], [], [])
        for gop in chain:
            own = slice(gop.start, gop.stop)
            pts, durations = known.pts[own], known.durations[own]
            read.pictures.append(SharedPictures(source, pts, known.checksums[own]))
            read.pts.append(np.array(pts, np.int64))
            read.durations.append(np.array(durations, np.int64))
        return read

    def skip(self, chain: Chain) -> None:
        """Do nothing: nothing is read."""
