"""What a video file holds, found by opening it and decoding its first frame."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import av
from av.container import InputContainer
from av.stream import Disposition
from av.video.stream import VideoStream

from gsvrcodec.container.chunk import SIGNATURE
from gsvrcodec.container.header import ColourInfo
from gsvrcodec.errors import NotAVideoError
from gsvrcodec.files import check_input
from gsvrcodec.video.colour import source_colour

_log = logging.getLogger(__name__)

#: Keeps names such as "12:30.mp4" from being taken for an address.
_FILE = "file:"

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
    sample_aspect: Fraction  #: width of a pixel over its height
    rotation: int  #: 0, 90, 180 or 270: degrees clockwise that a player turns the picture by
    bit_depth: int  #: bits a sample of the source
    pixel_format: str  #: FFmpeg's name of the source's pixel format
    codec: str  #: FFmpeg's name of the source's decoder
    interlaced: bool
    colour: ColourInfo


@contextmanager
def opened(path: Path) -> Iterator[tuple[InputContainer, VideoStream]]:
    """Open a file for decoding and close it after the block.

    Raises:
        InputError: the file cannot be read.
        NotAVideoError: it has no video stream.
    """
    _check_start(check_input(path))
    try:
        container = av.open(f"{_FILE}{path}", metadata_errors="replace")
    except (av.FFmpegError, ValueError) as error:
        raise NotAVideoError(f"{path} is not a video that can be read") from error
    with container:
        if container.format.name in _TEXT_ART:
            raise NotAVideoError(f"{path} is not a video: it looks like text")
        cover = Disposition.attached_pic
        streams = [s for s in container.streams.video if not s.disposition & cover]
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


def probe(path: str | os.PathLike[str]) -> VideoInfo:
    """Return what the first video stream of `path` is.

    Raises:
        InputError: the file is missing, a directory or unreadable.
        NotAVideoError: it is no video, or one without a single frame.
    """
    path = Path(path)
    with opened(path) as (container, stream):
        frame = next(decoded(container, stream), None)
        if frame is None:
            raise NotAVideoError(f"{path} has no video frames")
        context = stream.codec_context
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
            sample_aspect=aspect if aspect and aspect > 0 else Fraction(1),
            rotation=round(-frame.rotation / 90) % 4 * 90,
            bit_depth=max(component.bits for component in frame.format.components),
            pixel_format=frame.format.name,
            codec=context.name,
            interlaced=frame.interlaced_frame,
            colour=source_colour(frame),
        )


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
