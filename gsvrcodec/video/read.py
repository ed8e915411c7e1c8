"""Source video as a stream of RGB frames, with few frames in memory."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial
from types import TracebackType
from typing import Any, Self

import av
from av.container import InputContainer
from av.video.stream import VideoStream

from gsvrcodec.errors import NotAVideoError, UnsupportedError, UsageError
from gsvrcodec.video.colour import KNOWN_MATRICES, Rgb, to_rgb
from gsvrcodec.video.deinterlace import deinterlaced
from gsvrcodec.video.orientation import upright
from gsvrcodec.video.probe import VideoInfo, decoded, opened, probe
from gsvrcodec.video.timing import Part, Timeline, frame_rate

_log = logging.getLogger(__name__)

#: A source is cut short if it ends this much before the duration of its container, seconds.
_MISSING = Fraction(1, 4)

#: Width, height, column and row of a crop, pixels; column or row None = centred.
Crop = tuple[int, int, int | None, int | None]


@dataclass(frozen=True, slots=True, eq=False)
class SourceFrame:
    """One picture of the source with timestamp and duration."""

    rgb: Rgb  #: (H, W, 3) uint8, cropped
    pts: int  #: presentation timestamp, ticks of the time base
    duration: int  #: until the next frame, ticks


class VideoReader:
    """Frames of one video; every `iter()` starts again at the first frame."""

    def __init__(
        self,
        info: VideoInfo,
        part: Part,
        *,
        rate: Fraction | None = None,
        turned: tuple[int, bool] = (0, False),
        deinterlace: bool = False,
    ) -> None:
        """See `open_video`; `turned` is the rotation and mirroring to apply to the pictures."""
        self.info = info
        self.turned = turned  #: clockwise rotation, and whether mirrored, of the pictures
        self._part = part
        self._rate = rate
        self._deinterlace = deinterlace
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
        """Close the reader; later iteration raises `ValueError`."""
        self._closed = True

    def __iter__(self) -> Iterator[SourceFrame]:
        """Yield the chosen frames in presentation order.

        Raises:
            UsageError: The first chosen frame lies past the end.
            UnsupportedError: The picture size changes within the video.
            ValueError: The reader is closed.
        """
        if self._closed:
            raise ValueError("the video is closed")
        return (
            SourceFrame(self._picture(frame, f"frame {number}"), pts, duration)
            for frame, number, pts, duration in self._chosen()
        )

    def pictures(self) -> Iterator[Callable[[], Rgb]]:
        """Yield, of each chosen frame, a function that returns its picture, (H, W, 3).

        Frames whose pictures are not wanted take a fraction of the time. Errors as of `iter()`.
        """
        if self._closed:
            raise ValueError("the video is closed")
        return (
            partial(self._picture, frame, f"frame {number}")
            for frame, number, _, _ in self._chosen()
        )

    def frames(self) -> Iterator[av.VideoFrame]:
        """Yield the chosen frames as they are stored, not cropped; errors as of `iter()`."""
        if self._closed:
            raise ValueError("the video is closed")
        return (frame for frame, *_ in self._chosen())

    @property
    def expected_frames(self) -> int | None:
        """Number of the chosen frames by the container; None = not given."""
        info, part = self.info, self._part
        rate = float(info.average_rate or 0)
        total = info.frames
        if total is None and info.duration is not None and rate:
            total = round(float(info.duration) * rate)
        if total is None:
            return None
        found = total - max(part.start_frame, round(float(part.start_seconds or 0) * rate))
        if part.stop_seconds is not None and rate:
            found -= max(0, total - round(float(part.stop_seconds) * rate))
        return max(0, found if part.frames is None else min(found, part.frames))

    def from_key(self, pts: int | None) -> Iterator[tuple[int, Callable[[], Rgb]]]:
        """Yield all frames from the key frame at or before a timestamp on, chosen or not.

        Args:
            pts: Ticks of the time base; None = from the first frame.

        Yields:
            The timestamp of a frame, and a function that returns its picture, (H, W, 3), cropped.

        Raises:
            NotAVideoError: The file cannot be sought.
        """
        info = self.info
        with opened(info.path, self._rate) as (container, stream):
            if pts is not None:
                try:
                    container.seek(pts, stream=stream)
                except av.FFmpegError as error:
                    raise NotAVideoError(f"{info.path} cannot be sought") from error
            for frame, now in self._placed(container, stream, self._timeline(stream)):
                yield now, partial(self._picture, frame, f"{float(now * info.time_base):g} s")

    def _timeline(self, stream: VideoStream) -> Timeline:
        info = self.info
        return Timeline(str(info.path), info.time_base, self._rate or stream.guessed_rate)

    def _placed(
        self, container: InputContainer, stream: VideoStream, timeline: Timeline
    ) -> Iterator[tuple[av.VideoFrame, int]]:
        """Yield whole frames and their timestamps, ticks."""
        frames = decoded(container, stream)
        for frame in deinterlaced(frames, stream) if self._deinterlace else frames:
            # An explicit rate overrides the durations of a raw stream.
            yield frame, timeline.place(frame.pts, frame.duration if self._rate is None else 0)

    def _chosen(self) -> Iterator[tuple[av.VideoFrame, int, int, int]]:
        """Yield the chosen frames, their numbers, timestamps and durations, ticks.

        Each waits for the next frame's timestamp, its end.
        """
        info, part = self.info, self._part
        held: tuple[av.VideoFrame, int, int] | None = None
        count = given = 0
        with opened(info.path, self._rate) as (container, stream):
            timeline = self._timeline(stream)
            for frame, pts in self._placed(container, stream, timeline):
                if held is not None:
                    yield *held, pts - held[2]
                    held = None
                if part.starts(count, pts, info.time_base):
                    if part.ends(given, pts, info.time_base):
                        break
                    held = frame, count, pts
                    given += 1
                count += 1
            else:
                if held is not None:
                    yield *held, timeline.last_duration()
                if info.duration is not None and info.duration - timeline.length > _MISSING:
                    _log.warning(
                        "%s is cut short: %.2f s of %.2f s could be read",
                        *(info.path, timeline.length, info.duration),
                    )
        if not given:
            if part.start_seconds is None and part.stop_seconds is None:
                where = f"frame {part.start_frame} is past the end"
            else:
                where = "no frame starts in the chosen time"
            raise UsageError(f"{where}: {info.path} has {count} frames")

    def _picture(self, frame: av.VideoFrame, where: str) -> Rgb:
        """Return the cropped picture of a frame; `where` is its name in messages."""
        info = self.info
        size = (frame.height, frame.width) if self.turned[0] % 180 else (frame.width, frame.height)
        if size != (info.source_width, info.source_height):
            raise UnsupportedError(
                f"{info.path}: the picture size changes from "
                f"{info.source_width}x{info.source_height} to {size[0]}x{size[1]} "
                f"at {where}"
            )
        rows = slice(info.crop_y, info.crop_y + info.height)
        rgb = upright(to_rgb(frame), *self.turned)
        return rgb[rows, info.crop_x : info.crop_x + info.width]


def open_video(
    path: str | os.PathLike[str],
    crop: Crop | None = None,
    start_frame: int = 0,
    frames: int | None = None,
    *,
    start_seconds: float | Fraction | None = None,
    stop_seconds: float | Fraction | None = None,
    rate: float | Fraction | None = None,
    bake_rotation: bool = False,
    deinterlace: bool = False,
) -> VideoReader:
    """Open a video for reading as RGB.

    Args:
        path: Any file that FFmpeg reads, or numbered pictures such as in_%04d.png.
        crop: Width, height, column, row of the part to keep, pixels; None = the whole picture.
        start_frame: First frame to read, from 0.
        frames: Number of frames to read; None = to the end. Fewer if the video ends before.
        start_seconds: Instead of `start_frame`: read frames that start at this time or later.
            Seconds on the clock of the video's timestamps.
        stop_seconds: Instead of `frames`: read frames that start before this time.
        rate: Frame rate of inputs without timestamps: pictures and raw streams.
        bake_rotation: Turn and mirror the pictures as a player would; the crop applies afterwards.
        deinterlace: Deinterlace interlaced frames; without it interlaced video is refused.

    Raises:
        InputError: The file is missing, a directory or unreadable.
        NotAVideoError: The file has no video stream, or no frame.
        UnsupportedError: The video is interlaced.
        UsageError: The crop does not fit into the picture, a frame number is out of range, or
            arguments contradict each other.
    """
    part = Part(start_frame, frames, start_seconds, stop_seconds)
    asked_rate = None if rate is None else frame_rate(rate, "the rate")
    info = probe(path, asked_rate)
    if info.frames is not None and start_frame >= info.frames:
        raise UsageError(f"frame {start_frame} is past the end: {path} has {info.frames} frames")
    if info.interlaced and not deinterlace:
        raise UnsupportedError(
            f"{path} is interlaced, which cannot be coded; "
            "`deinterlace=True` makes whole pictures of it"
        )
    for warning in _warnings(info):
        _log.warning("%s: %s", path, warning)
    turned = (info.rotation, info.mirrored) if bake_rotation else (0, False)
    if bake_rotation:
        info = _upright(info)
    return VideoReader(
        info if crop is None else _cropped(info, crop),
        part,
        rate=asked_rate,
        turned=turned,
        deinterlace=deinterlace and info.interlaced,
    )


#: Arguments of `open_video` that an encode may set.
_OPTIONS = (
    "crop",
    "start_frame",
    "frames",
    "start_seconds",
    "stop_seconds",
    "rate",
    "bake_rotation",
    "deinterlace",
)


def reading_options(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments of `open_video` among the settings of an encode."""
    return {name: settings[name] for name in _OPTIONS if name in settings}


def _warnings(info: VideoInfo) -> Iterator[str]:
    """Yield warnings about properties of the source that are lost or changed."""
    if info.colour.matrix not in KNOWN_MATRICES:
        what = "BT.2020" if info.colour.matrix == 10 else "BT.601"
        yield f"colour matrix {info.colour.matrix} is taken for {what}"
    if info.alpha:
        yield "transparency is dropped"
    if info.other_videos:
        yield f"the first video stream is taken, {info.other_videos} more left out"


def _upright(info: VideoInfo) -> VideoInfo:
    """Return the properties of a video whose pictures are turned and mirrored."""
    if info.rotation % 180 == 0:
        return replace(info, rotation=0, mirrored=False)
    return replace(
        info,
        width=info.height,
        height=info.width,
        source_width=info.source_height,
        source_height=info.source_width,
        sample_aspect=1 / info.sample_aspect,
        rotation=0,
        mirrored=False,
    )


def _cropped(info: VideoInfo, crop: Crop) -> VideoInfo:
    """Return `info` with the crop applied; UsageError if the crop does not fit."""
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
