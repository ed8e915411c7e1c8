"""What a video file holds, found by opening it and decoding its first frame."""

from __future__ import annotations

import logging
import os
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
from av.container import InputContainer
from av.stream import Disposition, Stream
from av.video.stream import VideoStream

from gsvrcodec.bitstream.chunk import SIGNATURE
from gsvrcodec.bitstream.header import ColourInfo
from gsvrcodec.errors import NotAVideoError, UsageError
from gsvrcodec.files import check_input
from gsvrcodec.video.colour import source_colour
from gsvrcodec.video.orientation import orientation
from gsvrcodec.video.sequence import first_of_sequence

_log = logging.getLogger(__name__)

#: Keeps names such as "12:30.mp4" from being taken for an address.
_FILE = "file:"

_CLOCK = re.compile(r"(\d+):(\d\d):(\d\d(?:\.\d+)?)")

#: Demuxers of what has no times.
_UNTIMED = frozenset(
    {"image2", "h264", "hevc", "vvc", "av1", "obu", "m4v", "mpegvideo", "mjpeg", "dirac", "vc1"}
)

#: Demuxers that take any text or bytes for a picture of text.
_TEXT_ART = frozenset({"tty", "bin", "xbin", "adf", "idf"})


@dataclass(frozen=True, slots=True, kw_only=True)
class VideoInfo:
    """The video stream of a file, as it is stored: rotation and aspect are not applied."""

    path: Path
    width: int  #: after cropping, pixels
    height: int  #: after cropping, pixels
    source_width: int  #: before cropping, pixels
    source_height: int  #: before cropping, pixels
    crop_x: int  #: column of the source where the crop starts
    crop_y: int  #: row of the source where the crop starts
    time_base: Fraction  #: seconds a tick
    average_rate: Fraction | None  #: frames a second; None = unknown
    frames: int | None  #: what the container says of the whole stream; None = it does not
    duration: Fraction | None  #: seconds, what the container says; None = it does not
    sample_aspect: Fraction  #: width of a pixel over its height
    rotation: int  #: 0, 90, 180 or 270: degrees clockwise that a player turns the picture by
    mirrored: bool  #: whether a player mirrors the picture left to right before it turns it
    bit_depth: int  #: bits a sample of the source
    pixel_format: str  #: FFmpeg's name of the source's pixel format
    codec: str  #: FFmpeg's name of the source's decoder
    interlaced: bool
    alpha: bool  #: whether pixels are partly transparent, which is lost
    other_videos: int  #: further video streams of the file, which are left alone
    colour: ColourInfo


@contextmanager
def opened(
    path: Path, rate: Fraction | None = None
) -> Iterator[tuple[InputContainer, VideoStream]]:
    """Open a file, or numbered pictures such as in_%04d.png, and close it after the block.

    Args:
        path: what to open.
        rate: frames a second of what has no times of its own: pictures and raw streams.

    Raises:
        InputError: the file cannot be read.
        NotAVideoError: it has no video stream.
        UsageError: it has times of its own, and `rate` is given.
    """
    options = {} if rate is None else {"framerate": str(rate)}
    first, kind = first_of_sequence(path), None
    if first is None:
        _check_start(check_input(path))
    else:
        kind, options["start_number"] = "image2", str(first)
    try:
        container = av.open(f"{_FILE}{path}", "r", kind, options, metadata_errors="replace")
    except (av.FFmpegError, ValueError) as error:
        raise NotAVideoError(f"{path} is not a video that can be read") from error
    with container:
        if container.format.name in _TEXT_ART:
            raise NotAVideoError(f"{path} is not a video: it looks like text")
        if rate is not None and container.format.name not in _UNTIMED:
            raise UsageError(f"`rate` is for pictures and raw streams; {path} has its own times")
        streams = [stream for stream in container.streams.video if not _is_cover(stream)]
        if not streams:
            kinds = sorted({stream.type for stream in container.streams if stream.type != "video"})
            held = f": it holds {' and '.join(kinds)} only" if kinds else ""
            raise NotAVideoError(f"{path} has no video stream{held}")
        streams[0].thread_type = "AUTO"
        yield container, streams[0]


def decoded(container: InputContainer, stream: VideoStream) -> Iterator[av.VideoFrame]:
    """Yield every frame that can be decoded; what is damaged is skipped with a warning."""
    name = container.name.removeprefix(_FILE)
    packets = container.demux(stream)
    whole = True
    while True:
        try:
            packet = next(packets, None)
            if packet is None:
                return
            yield from packet.decode()
        except av.InvalidDataError:
            if whole:
                _log.warning("%s is damaged: what cannot be decoded is left out", name)
            whole = False
        except av.FFmpegError as error:
            raise NotAVideoError(f"{name} cannot be decoded: {error.strerror}") from error


def demuxed(container: InputContainer, streams: Sequence[Stream]) -> Iterator[av.Packet[Any]]:
    """Yield every packet of `streams`, in the order of the file; what is damaged ends it."""
    packets = container.demux(*streams) if streams else iter(())
    while True:
        try:
            packet = next(packets, None)
        except av.FFmpegError as error:
            _log.warning("sound or subtitles break off: %s", error.strerror)
            return
        if packet is None:
            return
        if packet.size or packet.dts is not None:  # else it only tells that the stream has ended
            yield packet


def probe(path: str | os.PathLike[str], rate: Fraction | None = None) -> VideoInfo:
    """Return what the first video stream of `path` is; arguments and errors as `opened`."""
    path = Path(path)
    with opened(path, rate) as (container, stream):
        frame = next(decoded(container, stream), None)
        if frame is None:
            raise NotAVideoError(f"{path} has no video frames")
        context = stream.codec_context
        rotation, mirrored = orientation(frame)
        aspect = stream.sample_aspect_ratio or context.sample_aspect_ratio
        return VideoInfo(
            path=path,
            width=frame.width,
            height=frame.height,
            source_width=frame.width,
            source_height=frame.height,
            crop_x=0,
            crop_y=0,
            time_base=stream.time_base or Fraction(1, 90_000),
            average_rate=_rate(stream, timed=frame.pts is not None),
            frames=stream.frames or None,
            duration=_duration(stream),
            sample_aspect=aspect if aspect and aspect > 0 else Fraction(1),
            rotation=rotation,
            mirrored=mirrored,
            bit_depth=max(component.bits for component in frame.format.components),
            pixel_format=frame.format.name,
            codec=context.name,
            interlaced=frame.interlaced_frame,
            alpha=any(component.is_alpha for component in frame.format.components),
            other_videos=sum(not _is_cover(s) for s in container.streams.video) - 1,
            colour=source_colour(frame),
        )


def _duration(stream: VideoStream) -> Fraction | None:
    """Return how long a stream is by its container, seconds."""
    if stream.duration is not None and stream.time_base is not None:
        return stream.duration * stream.time_base
    written = _CLOCK.fullmatch(stream.metadata.get("DURATION", ""))  # by Matroska's muxers
    if written is None:
        return None
    hours, minutes, seconds = written.groups()
    return 3600 * int(hours) + 60 * int(minutes) + Fraction(seconds)


def _is_cover(stream: Stream) -> bool:
    """Return whether a video stream is only the cover of a sound track."""
    return bool(stream.disposition & Disposition.attached_pic)


def _rate(stream: VideoStream, *, timed: bool) -> Fraction | None:
    """Return the frame rate that is most likely; `timed` = frames come with timestamps."""
    average, guessed = stream.average_rate, stream.guessed_rate
    for rate in (average, guessed) if timed else (guessed, average):
        if rate and rate > 0:
            return rate
    return None


def _check_start(path: Path) -> None:
    """Refuse what FFmpeg need not see."""
    with path.open("rb") as file:
        start = file.read(len(SIGNATURE))
    if not start:
        raise NotAVideoError(f"{path} is not a video: it is empty")
    if start == SIGNATURE:
        raise NotAVideoError(f"{path} is a .gsvr file already")
