"""Frames of a chain: read here, sent packed, or read by the worker."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain, islice
from typing import Any, Protocol

import imagecodecs
import numpy as np
from numpy.typing import NDArray

from gsvrcodec.encoder.film import Chain
from gsvrcodec.encoder.lookahead import Lookahead, checksum
from gsvrcodec.errors import GsvrError, InputError, NotAVideoError
from gsvrcodec.model.time import Ticks
from gsvrcodec.video import Rgb, SourceFrame, VideoReader, open_video

#: Few suffice: reading takes as long as packing on one core.
_THREADS = 4
Pictures = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class PackedPictures:
    """Packed pictures of one GOP."""

    frames: list[bytes]  #: a JPEG XL codestream each
    size: tuple[int, int]  #: height and width, pixels

    def __len__(self) -> int:
        """Return how many pictures there are."""
        return len(self.frames)

    def unpacked(self) -> Pictures:
        """Return (F, H, W, 3) RGB, exactly as packed."""
        pictures = np.empty((len(self.frames), *self.size, 3), np.uint8)
        for frame, picture in zip(self.frames, pictures, strict=True):
            imagecodecs.jpegxl_decode(frame, numthreads=1, out=picture)
        return pictures


def packed(pictures: Pictures) -> PackedPictures:
    """Pack pictures, (F, H, W, 3) RGB, side by side."""
    with ThreadPoolExecutor(_THREADS) as pool:
        frames = list(pool.map(_packed, pictures))
    return PackedPictures(frames, (pictures.shape[1], pictures.shape[2]))


def _packed(picture: Pictures) -> bytes:
    return bytes(imagecodecs.jpegxl_encode(picture, lossless=True, effort=1, numthreads=1))


#: Where reading begins, seconds before the first picture: at the key frame there; further back,
#: because decoders may need more than one key frame; None = at the start of the file.
_BEFORE = (0, 10, None)
_Frames = Iterator[tuple[int, Callable[[], Rgb]]]


class SharedSource:
    """A file that several processes see; its pickle opens the file anew.

    Args:
        path: of the file, absolute.
        options: arguments of `open_video`.
    """

    def __init__(self, path: str, options: Mapping[str, Any]) -> None:
        self._path, self._options = path, options
        self._video: VideoReader | None = None
        self._going_on: _Frames = iter(())  # behind the last picture that was read

    def __getstate__(self) -> dict[str, Any]:
        """Leave out the open file."""
        return {**self.__dict__, "_video": None, "_going_on": iter(())}

    def pictures(self, pts: Sequence[int], checksums: Sequence[int]) -> Pictures:
        """Read successive pictures, (F, H, W, 3) RGB.

        Args:
            pts: timestamps, ticks.
            checksums: of the samples of each.

        Raises:
            InputError: the file cannot be read here, or has other pictures.
        """
        try:
            video = self._video = self._video or open_video(self._path, **self._options)
            for frames in chain((self._going_on,), self._starts(video, pts[0])):
                with suppress(NotAVideoError):  # no seeking in this file
                    found = _matching(frames, pts, checksums)
                    if found is not None:
                        self._going_on = frames
                        return found
        except GsvrError as error:
            raise InputError(f"{error}, as one of the workers sees it") from error
        where = float(pts[0] * video.info.time_base)
        raise InputError(
            f"{self._path} has other pictures at {where:.2f} s where one of the workers reads it: "
            "it is another file, or another version of FFmpeg"
        )

    def _starts(self, video: VideoReader, first: int) -> Iterator[_Frames]:
        for seconds in _BEFORE:
            back = None if seconds is None else first - int(seconds / video.info.time_base)
            yield video.from_key(back)


def _matching(frames: _Frames, pts: Sequence[int], checksums: Sequence[int]) -> Pictures | None:
    """Return pictures with these timestamps and checksums, or None at the first that differs."""
    found: list[Rgb] = []
    for now, picture in frames:
        if now < pts[0]:
            continue
        if now != pts[len(found)]:
            return None
        found.append(picture())
        if checksum(found[-1]) != checksums[len(found) - 1]:
            return None
        if len(found) == len(pts):
            return np.stack(found)
    return None


@dataclass(frozen=True, slots=True, eq=False)
class SharedPictures:
    """Pictures of one GOP, in a source that is read when they are wanted."""

    source: SharedSource
    pts: Sequence[int]  #: ticks
    checksums: Sequence[int]

    def __len__(self) -> int:
        """Return how many pictures there are."""
        return len(self.pts)

    def unpacked(self) -> Pictures:
        """Return (F, H, W, 3) RGB; raises as `SharedSource.pictures`."""
        return self.source.pictures(self.pts, self.checksums)


@dataclass(frozen=True, slots=True, eq=False)
class ChainFrames:
    """The frames of a chain, by GOP."""

    gops: Sequence[range]  #: numbers of the frames
    #: (F, H, W, 3) RGB of each; emptied as they go
    pictures: list[Pictures | PackedPictures | SharedPictures]
    pts: list[Ticks]  #: (F,) ticks of each
    durations: list[Ticks]  #: (F,) ticks of each

    def take(self, number: int) -> Pictures:
        """Return the pictures of a GOP, (F, H, W, 3), and let go of them."""
        found, self.pictures[number] = self.pictures[number], np.empty((0, 0, 0, 3), np.uint8)
        return found if isinstance(found, np.ndarray) else found.unpacked()


class ChainReader(Protocol):
    """Gets the frames of chains, in the order of the film."""

    def read(self, chain: Chain, finished: int) -> ChainFrames:
        """Return the frames of a chain; no pictures of its `finished` GOPs but for the last."""

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
            kept = len(gop) if number >= finished - 1 else 0
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
