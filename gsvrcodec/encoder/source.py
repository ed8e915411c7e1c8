"""Frames of a chain: read here, sent packed, or read by the worker."""

from __future__ import annotations

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
from gsvrcodec.video import Rgb, VideoReader, open_video

#: Few suffice: reading takes as long as packing on one core.
_THREADS = 4
Pictures = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class PackedPictures:
    """Packed pictures."""

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
        """Read pictures, (F, H, W, 3) RGB.

        Args:
            pts: timestamps, ticks, one later than the other.
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
        if now < pts[len(found)]:
            continue
        if now > pts[len(found)]:
            return None
        found.append(picture())
        if checksum(found[-1]) != checksums[len(found) - 1]:
            return None
        if len(found) == len(pts):
            return np.stack(found)
    return None


@dataclass(frozen=True, slots=True, eq=False)
class SharedPictures:
    """Pictures in a source that is read when they are wanted."""

    source: SharedSource
    pts: Sequence[int]  #: ticks
    checksums: Sequence[int]

    def __len__(self) -> int:
        """Return how many pictures there are."""
        return len(self.pts)

    def unpacked(self) -> Pictures:
        """Return (F, H, W, 3) RGB; raises as `SharedSource.pictures`."""
        return self.source.pictures(self.pts, self.checksums)


class Onward:
    """Reads a video forward: some pictures, then some that come later."""

    def __init__(self, video: VideoReader) -> None:
        self._info, self._later = video.info, video.pictures()
        self.next = 0  #: number of the frame that comes next
        self.stop = 0  #: behind the last frame that it is to read

    def read(self, numbers: Sequence[int]) -> Pictures:
        """Return pictures, (F, H, W, 3) RGB; InputError if the video has become shorter."""
        info = self._info
        pictures = np.empty((len(numbers), info.height, info.width, 3), np.uint8)
        for out, number in zip(pictures, numbers, strict=True):
            picture = next(islice(self._later, number - self.next, None), None)
            if picture is None:
                raise InputError(f"{info.path} became shorter while it was read")
            out[:] = picture()
            self.next = number + 1
        return pictures


@dataclass(frozen=True, slots=True, eq=False)
class LaterPictures:
    """Pictures that are read when they are wanted."""

    numbers: Sequence[int]  #: of the frames
    read: Callable[[Sequence[int]], Pictures]

    def __len__(self) -> int:
        """Return how many pictures there are."""
        return len(self.numbers)

    def unpacked(self) -> Pictures:
        """Return (F, H, W, 3) RGB; raises as `Onward.read`."""
        return self.read(self.numbers)


#: Pictures that are not at hand.
_Absent = PackedPictures | SharedPictures | LaterPictures
#: Pictures of one GOP, at hand or not.
GopPictures = Pictures | _Absent


@dataclass(frozen=True, slots=True, eq=False)
class ChainFrames:
    """The frames of a chain, by GOP."""

    gops: Sequence[range]  #: numbers of the frames
    #: (F, H, W, 3) RGB of each; emptied as they go
    pictures: list[GopPictures]
    pts: list[Ticks]  #: (F,) ticks of each
    durations: list[Ticks]  #: (F,) ticks of each

    def take(self, number: int) -> Pictures:
        """Return the pictures of a GOP, (F, H, W, 3), and let go of them."""
        found, self.pictures[number] = self.pictures[number], np.empty((0, 0, 0, 3), np.uint8)
        return found if isinstance(found, np.ndarray) else found.unpacked()


class ChainReader(Protocol):
    """Gets the frames of chains, in the order of the film."""

    ahead: Onward  #: reads frames of chains that are read later

    def read(self, chain: Chain, finished: int) -> ChainFrames:
        """Return the frames of a chain; no pictures of its `finished` GOPs but for the last."""


class Times(Protocol):
    """Times of the frames of a film, as far as they are known."""

    @property
    def pts(self) -> Sequence[int]:
        """Of each frame, ticks."""

    @property
    def durations(self) -> Sequence[int]:
        """Of each frame, ticks."""


class ReadHere(ChainReader):
    """Reads the source in this process; chains side by side each go forward on their own.

    Args:
        video: the source.
        times: of its frames.
        pack: read and pack the pictures of all GOPs of a chain at once, to be sent.
    """

    def __init__(self, video: VideoReader, times: Times, *, pack: bool) -> None:
        self._video, self._times, self._pack = video, times, pack
        self._readers: list[Onward] = []
        self.ahead = Onward(video)

    def read(self, chain: Chain, finished: int) -> ChainFrames:
        """Return frames that are read when they are taken, GOP by GOP."""
        left_out = max(finished - 1, 0)
        reader = self._reader(range(chain[left_out].start, chain[-1].stop))
        later = [LaterPictures(gop, reader.read) for gop in chain[left_out:]]
        pictures: list[GopPictures] = [np.empty((0, 0, 0, 3), np.uint8)] * left_out
        pictures += [packed(one.unpacked()) for one in later] if self._pack else later
        return ChainFrames(chain, pictures, *_times_of(chain, self._times))

    def _reader(self, numbers: Sequence[int]) -> Onward:
        """Return a reader for frames: one that is done, the nearest before them, or a new one."""
        done = [one for one in self._readers if one.stop <= one.next <= numbers[0]]
        if not done:
            self._readers.append(Onward(self._video))
        reader = max(done, key=lambda one: one.next, default=self._readers[-1])
        reader.stop = numbers[-1] + 1
        return reader


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
        self.ahead = Onward(video)

    def read(self, chain: Chain, finished: int) -> ChainFrames:
        """Return frames that are read where they are unpacked."""
        source, known = SharedSource(self._path, self._options), self._known
        pictures: list[GopPictures] = []
        for gop in chain:
            pictures.append(self._shared(source, gop))
        return ChainFrames(chain, pictures, *_times_of(chain, known))

    def _shared(self, source: SharedSource, numbers: Sequence[int]) -> SharedPictures:
        known = self._known
        pts, checksums = ([of[n] for n in numbers] for of in (known.pts, known.checksums))
        return SharedPictures(source, pts, checksums)


def _times_of(chain: Chain, times: Times) -> tuple[list[Ticks], list[Ticks]]:
    """Timestamps and durations of the frames of each GOP, (F,) ticks each."""
    found = times.pts, times.durations
    pts, durations = ([np.array(one[g.start : g.stop], np.int64) for g in chain] for one in found)
    return pts, durations
