"""Source video as a stream of RGB frames, never more than a few in memory."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from types import TracebackType
from typing import Self

import av

from gsvrcodec.errors import UnsupportedError, UsageError
from gsvrcodec.video.colour import Rgb, to_rgb
from gsvrcodec.video.probe import VideoInfo, decoded, opened, probe
from gsvrcodec.video.timing import Timeline

_log = logging.getLogger(__name__)

#: Width, height, column, row in pixels; a None column or row centres the crop.
Crop = tuple[int, int, int | None, int | None]


@dataclass(frozen=True, slots=True, eq=False)
class SourceFrame:
    """One picture of the source and the time it is shown."""

    rgb: Rgb  #: (H, W, 3) uint8, cropped
    pts: int  #: presentation time, ticks of the time base
    duration: int  #: until the next frame, ticks


class VideoReader:
    """Frames of one video; every `iter()` starts again from the first."""

    def __init__(self, info: VideoInfo, start_frame: int, frames: int | None) -> None:
        """Use `open_video`."""
        self.info = info
        self._start = start_frame
        self._frames = frames
        self._closed = False

    def __enter__(self) -> Self:
        """Return the reader itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the reader."""
        self.close()

    def close(self) -> None:
        """Refuse further iteration."""
        self._closed = True

    def __iter__(self) -> Iterator[SourceFrame]:
        """Yield the chosen frames in presentation order.

        Raises:
            UsageError: the first chosen frame lies past the end.
            UnsupportedError: the picture size changes within the video.
            ValueError: the reader is closed.
        """
        if self._closed:
            raise ValueError("the video is closed")
        return self._chosen()

    def _chosen(self) -> Iterator[SourceFrame]:
        """Yield frames one step behind the decoder: a duration ends where the next frame starts."""
        info = self.info
        stop = None if self._frames is None else self._start + self._frames
        held: tuple[Rgb, int] | None = None
        count = 0
        with opened(info.path) as (container, stream):
            timeline = Timeline(str(info.path), info.time_base, stream.guessed_rate)
            for frame in decoded(container, stream):
                pts = timeline.place(frame.pts, frame.duration)
                if held is not None:
                    yield SourceFrame(*held, duration=pts - held[1])
                    held = None
                if count == stop:
                    return
                if count >= self._start:
                    held = self._picture(frame, count), pts
                count += 1
            if held is not None:
                yield SourceFrame(*held, duration=timeline.last_duration())
        if count <= self._start:
            raise UsageError(
                f"frame {self._start} is past the end: {info.path} has {count} frames"
                if count
                else f"{info.path} has no video frames"
            )

    def _picture(self, frame: av.VideoFrame, number: int) -> Rgb:
        """Return the cropped picture of frame `number`."""
        info = self.info
        if (frame.width, frame.height) != (info.source_width, info.source_height):
            raise UnsupportedError(
                f"{info.path}: the picture size changes from "
                f"{info.source_width}x{info.source_height} to {frame.width}x{frame.height} "
                f"at frame {number}"
            )
        rows = slice(info.crop_y, info.crop_y + info.height)
        return to_rgb(frame)[rows, info.crop_x : info.crop_x + info.width]


def open_video(
    path: str | os.PathLike[str],
    crop: Crop | None = None,
    start_frame: int = 0,
    frames: int | None = None,
) -> VideoReader:
    """Open a video for reading as RGB.

    Args:
        path: any file that FFmpeg reads.
        crop: width, height, column, row of the part to keep, pixels; None = all of it.
        start_frame: first frame to give, from 0.
        frames: how many frames to give; None = to the end. Fewer come if the video ends before.

    Raises:
        InputError: the file is missing, a directory or unreadable.
        NotAVideoError: it is no video, or one without a single frame.
        UsageError: the crop does not fit into the picture, or a frame number is out of range.
    """
    if start_frame < 0:
        raise UsageError(f"the first frame must be 0 or more, not {start_frame}")
    if frames is not None and frames < 1:
        raise UsageError(f"the number of frames must be 1 or more, not {frames}")
    info = probe(path)
    if info.frames is not None and start_frame >= info.frames:
        raise UsageError(f"frame {start_frame} is past the end: {path} has {info.frames} frames")
    if info.interlaced:
        _log.warning("%s is interlaced: its fields are coded as they are, in one picture", path)
    return VideoReader(info if crop is None else _cropped(info, crop), start_frame, frames)


def _cropped(info: VideoInfo, crop: Crop) -> VideoInfo:
    """Return `info` with the crop worked out."""
    width, height, x, y = crop
    if width < 1 or height < 1:
        raise UsageError(f"a crop of {width}x{height} holds no pixel")
    size = f"the picture of {info.path} ({info.source_width}x{info.source_height})"
    if width > info.source_width or height > info.source_height:
        raise UsageError(f"a crop of {width}x{height} is larger than {size}")
    x = (info.source_width - width) // 2 if x is None else x
    y = (info.source_height - height) // 2 if y is None else y
    if not (0 <= x <= info.source_width - width and 0 <= y <= info.source_height - height):
        raise UsageError(f"a crop of {width}x{height} at {x},{y} reaches outside {size}")
    return replace(info, width=width, height=height, crop_x=x, crop_y=y)
