"""Properties of a video file, from its container and its first frame."""

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

#: FFmpeg's prefix for files; without it a name such as "12:30.mp4" is taken for a URL.
_FILE = "file:"

_CLOCK = re.compile(r"(\d+):(\d\d):(\d\d(?:\.\d+)?)")

#: Demuxers of formats without timestamps.
_UNTIMED = frozenset(
    {"image2", "h264", "hevc", "vvc", "av1", "obu", "m4v", "mpegvideo", "mjpeg", "dirac", "vc1"}
)

#: Demuxers that accept any text or bytes as text art.
_TEXT_ART = frozenset({"tty", "bin", "xbin", "adf", "idf"})


@dataclass(frozen=True, slots=True, kw_only=True)
class VideoInfo:
    """Properties of a video stream as stored: rotation and sample aspect are not applied."""

    path: Path
    width: int  #: after cropping, pixels
    height: int  #: after cropping, pixels
    source_width: int  #: before cropping, pixels
    source_height: int  #: before cropping, pixels
    crop_x: int  #: column of the source where the crop starts
    crop_y: int  #: row of the source where the crop starts
    time_base: Fraction  #: seconds a tick
    average_rate: Fraction | None  #: frames a second; None = not known
    frames: int | None  #: frames of the whole stream by the container; None = not given
    duration: Fraction | None  #: duration by the container, seconds; None = not given
    sample_aspect: Fraction  #: width of a pixel over its height
    rotation: int  #: 0, 90, 180 or 270: degrees clockwise that a player turns the picture by
    mirrored: bool  #: whether a player mirrors the picture left to right before it turns it
    bit_depth: int  #: bits a sample of the source
    pixel_format: str  #: FFmpeg's name of the source's pixel format
    codec: str  #: FFmpeg's name of the source's decoder
    interlaced: bool
    alpha: bool  #: whether the pictures have an alpha channel, which is dropped
    other_videos: int  #: further video streams of the file, which are ignored
    colour: ColourInfo


@contextmanager
def opened(
    path: Path, rate: Fraction | None = None
) -> Iterator[tuple[InputContainer, VideoStream]]:
    """Open a file, or numbered pictures such as in_%04d.png, and close it after the block.

    Args:
        path: The file, or the pattern of numbered pictures.
        rate: Frame rate of inputs without timestamps: pictures and raw streams.

    Raises:
        InputError: The file cannot be read.
        NotAVideoError: The file has no video stream.
        UsageError: The file has timestamps, and `rate` is given.
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
    """Yield every frame that can be decoded; damaged packets are skipped with a warning."""
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
    """Yield the packets of `streams` in file order; damage ends the iteration with a warning."""
    packets = container.demux(*streams) if streams else iter(())
    while True:
        try:
            packet = next(packets, None)
        except av.FFmpegError as error:
            _log.warning("sound or subtitles break off: %s", error.strerror)
            return
        if packet is None:
            return
        if packet.size or packet.dts is not None:  # else: end of stream
            yield packet


def probe(path: str | os.PathLike[str], rate: Fraction | None = None) -> VideoInfo:
    """Return the properties of the first video stream; arguments and errors as of `opened`."""
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
    """Return the duration of a stream by its container, seconds."""
    if stream.duration is not None and stream.time_base is not None:
        return stream.duration * stream.time_base
    written = _CLOCK.fullmatch(stream.metadata.get("DURATION", ""))  # tag of Matroska's muxers
    if written is None:
        return None
    hours, minutes, seconds = written.groups()
    return 3600 * int(hours) + 60 * int(minutes) + Fraction(seconds)


def _is_cover(stream: Stream) -> bool:
    """Return whether a video stream is a cover picture."""
    return bool(stream.disposition & Disposition.attached_pic)


def _rate(stream: VideoStream, *, timed: bool) -> Fraction | None:
    """Return the most likely frame rate; `timed` = frames have timestamps."""
    average, guessed = stream.average_rate, stream.guessed_rate
    for rate in (average, guessed) if timed else (guessed, average):
        if rate and rate > 0:
            return rate
    return None


def _check_start(path: Path) -> None:
    """Raise a NotAVideoError for an empty file and for a .gsvr file."""
    with path.open("rb") as file:
        start = file.read(len(SIGNATURE))
    if not start:
        raise NotAVideoError(f"{path} is not a video: it is empty")
    if start == SIGNATURE:
        raise NotAVideoError(f"{path} is a .gsvr file already")
