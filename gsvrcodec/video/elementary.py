"""Video streams without a container, in memory: what another encoder makes of the same frames."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from itertools import islice

import av
import numpy as np

from gsvrcodec.errors import UsageError
from gsvrcodec.video.colour import Rgb, to_rgb, to_ycbcr, ycbcr_format
from gsvrcodec.video.probe import VideoInfo, decoded, opened

#: Pixel formats that are 8-bit YCbCr 4:2:0.
_FOUR_TWO_ZERO = ("yuv420p", "yuvj420p")


@dataclass(frozen=True, slots=True, eq=False)
class ElementaryStream:
    """Coded frames, one after another."""

    packets: tuple[av.Packet[av.VideoStream], ...]

    @property
    def size(self) -> int:
        """Bytes."""
        return sum(packet.size for packet in self.packets)

    @property
    def key_frames(self) -> int:
        """How many frames decoding may start at."""
        return sum(packet.is_keyframe for packet in self.packets)

    @property
    def start(self) -> bytes:
        """The first coded frame; some encoders leave their name and version in it."""
        return bytes(self.packets[0])

    def pictures(self, decoder: str, threads: int = 0) -> Iterator[Rgb]:
        """Yield the decoded pictures.

        Args:
            decoder: FFmpeg's name of it.
            threads: to decode with; 0 = all cores.
        """
        context = av.CodecContext.create(decoder, "r")
        assert isinstance(context, av.VideoCodecContext)
        context.thread_type, context.thread_count = "AUTO", threads
        for packet in (*self.packets, None):
            for frame in context.decode(packet):
                yield to_rgb(frame)


def has_encoder(name: str) -> bool:
    """Return whether the FFmpeg inside PyAV was built with an encoder."""
    return name in av.codec.codecs_available


def encode_stream(
    frames: Iterable[av.VideoFrame],
    info: VideoInfo,
    encoder: str,
    options: Mapping[str, str],
    threads: int = 0,
) -> ElementaryStream:
    """Code frames, one tick each.

    Args:
        frames: of one size, pixel format and colour.
        info: the source: its size and rate.
        encoder: FFmpeg's name of it.
        options: FFmpeg's options for it.
        threads: to encode with; 0 = all cores.

    Raises:
        UsageError: the encoder refuses the options or the pictures.
    """
    # SVT-AV1 prints its settings past FFmpeg's log, unless it is told otherwise in this way.
    os.environ.setdefault("SVT_LOG", "1")
    rate = info.average_rate or Fraction(25)
    context = av.CodecContext.create(encoder, "w")
    assert isinstance(context, av.VideoCodecContext)
    context.width, context.height = info.width, info.height
    context.framerate, context.time_base = rate, 1 / rate
    context.thread_count = threads
    context.options = dict(options)
    packets: list[av.Packet[av.VideoStream]] = []
    try:
        for number, frame in enumerate(frames):
            if number == 0:
                context.pix_fmt = frame.format.name
                context.colorspace, context.color_range = frame.colorspace, frame.color_range
                with _own_scheduling():
                    context.open()
            frame.pts, frame.time_base = number, context.time_base
            packets += context.encode(frame)
        packets += context.encode(None)
    except av.FFmpegError as error:
        raise UsageError(
            f"{encoder} refuses pictures of {info.width}x{info.height} with options "
            f"{', '.join(f'{key} {value}' for key, value in options.items())}: {error.strerror}"
        ) from error
    return ElementaryStream(tuple(packets))


@contextmanager
def _own_scheduling() -> Iterator[None]:
    """Undo a change of how this thread is scheduled.

    SVT-AV1 makes whoever opens it a real-time thread if root does; all that is started later
    would be one too, and keep everything else off its core.
    """
    if not hasattr(os, "sched_getscheduler"):
        yield
        return
    policy, priority = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        yield
    finally:
        if os.sched_getscheduler(0) != policy:
            os.sched_setscheduler(0, policy, priority)


def ycbcr_frames(pictures: Iterable[Rgb], info: VideoInfo) -> Iterator[av.VideoFrame]:
    """Yield RGB pictures of a source as YCbCr, 4:2:0 where both sides are even."""
    pixel_format = ycbcr_format(info.width, info.height)
    for rgb in pictures:
        yield to_ycbcr(rgb, pixel_format, info.colour)


def source_frames(info: VideoInfo, start: int, count: int) -> Iterator[av.VideoFrame]:
    """Yield `count` frames of a source from number `start` as they are, cropped.

    Raises:
        UsageError: they are not 8-bit YCbCr 4:2:0, or the crop is odd.
    """
    if info.pixel_format not in _FOUR_TWO_ZERO or any(
        number % 2 for number in (info.width, info.height, info.crop_x, info.crop_y)
    ):
        raise UsageError(
            f"input=source needs 8-bit YCbCr 4:2:0 and an even crop; {info.path} has "
            f"{info.pixel_format} of {info.width}x{info.height} at {info.crop_x},{info.crop_y}"
        )
    with opened(info.path) as (container, stream):
        for frame in islice(decoded(container, stream), start, start + count):
            yield _cut(frame, info)


def _cut(frame: av.VideoFrame, info: VideoInfo) -> av.VideoFrame:
    """Return the cropped part of a 4:2:0 frame, with its tags."""
    parts = []
    for plane, factor in zip(frame.planes, (1, 2, 2), strict=True):
        samples = np.frombuffer(memoryview(plane), np.uint8).reshape(-1, plane.line_size)
        y, x = info.crop_y // factor, info.crop_x // factor
        part = samples[y : y + info.height // factor, x : x + info.width // factor]
        parts.append(part.reshape(-1))
    cut = av.VideoFrame.from_ndarray(
        np.concatenate(parts).reshape(-1, info.width), format=frame.format.name
    )
    cut.colorspace, cut.color_range = frame.colorspace, frame.color_range
    return cut
