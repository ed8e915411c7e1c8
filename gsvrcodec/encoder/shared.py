"""Pictures of a source that workers see at the same path, read by the worker that fits them."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np

from gsvrcodec.encoder.packed import Pictures
from gsvrcodec.errors import GsvrError, InputError, NotAVideoError
from gsvrcodec.video import Rgb, VideoReader, open_video

#: Where reading begins, seconds before the first picture: at the key frame there; further back,
#: because decoders may need more than one key frame; None = at the start of the file.
_BEFORE = (0, 10, None)

_Frames = Iterator[tuple[int, Callable[[], Rgb]]]


def checksum(picture: Rgb) -> int:
    """Return the CRC-32 of the samples of a picture, (H, W, 3) uint8."""
    return zlib.crc32(np.ascontiguousarray(picture).data)


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
