"""Elementary video streams in memory, coded by other encoders for comparison."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction

import av
import numpy as np
from av.video.reformatter import ColorRange

from gsvrcodec.errors import UsageError
from gsvrcodec.video.colour import Rgb, to_rgb, to_ycbcr, ycbcr_format
from gsvrcodec.video.probe import VideoInfo
from gsvrcodec.video.read import VideoReader

#: Pixel formats that are 8-bit YCbCr 4:2:0.
_FOUR_TWO_ZERO = ("yuv420p", "yuvj420p")


@dataclass(frozen=True, slots=True, eq=False)
class ElementaryStream:
    """Coded frames of a stream without a container."""

    packets: tuple[av.Packet[av.VideoStream], ...]

    @property
    def size(self) -> int:
        """Size of the stream, bytes."""
        return sum(packet.size for packet in self.packets)

    @property
    def key_frames(self) -> int:
        """Number of key frames."""
        return sum(packet.is_keyframe for packet in self.packets)

    @property
    def start(self) -> bytes:
        """The first coded frame; some encoders write their name and version into it."""
        return bytes(self.packets[0])

    def pictures(self, decoder: str, threads: int = 0) -> Iterator[Rgb]:
        """Yield the decoded pictures.

        Args:
            decoder: FFmpeg's name of the decoder.
            threads: Threads for decoding; 0 = all cores.
        """
        context = av.CodecContext.create(decoder, "r")
        assert isinstance(context, av.VideoCodecContext)
        context.thread_type, context.thread_count = "AUTO", threads
        for packet in (*self.packets, None):
            for frame in context.decode(packet):
                yield to_rgb(frame)


def has_encoder(name: str) -> bool:
    """Return whether PyAV's FFmpeg was built with an encoder."""
    return name in av.codec.codecs_available


def encode_stream(
    frames: Iterable[av.VideoFrame],
    info: VideoInfo,
    encoder: str,
    options: Mapping[str, str],
    threads: int = 0,
) -> ElementaryStream:
    """Encode frames, one tick each.

    Args:
        frames: Frames of one size, pixel format and colour.
        info: Size and frame rate of the source.
        encoder: FFmpeg's name of the encoder.
        options: FFmpeg's options of the encoder.
        threads: Threads for encoding; 0 = all cores.

    Raises:
        UsageError: The encoder rejects the options or the pictures.
    """
    # SVT-AV1 prints its settings to stderr, not to FFmpeg's log; this keeps it to errors.
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
    """Restore the scheduling policy of this thread after the block.

    Run by root, SVT-AV1 makes the thread that opens it a real-time thread. Threads started later
    would inherit that policy and block other work on their cores.
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
    """Yield RGB pictures of a source as YCbCr frames, 4:2:0, or 4:4:4 if a side is odd."""
    pixel_format = ycbcr_format(info.width, info.height)
    for rgb in pictures:
        yield to_ycbcr(rgb, pixel_format, info.colour)


def source_frames(video: VideoReader) -> Iterator[av.VideoFrame]:
    """Yield the frames of a source for another encoder.

    They are the source's own samples where it has 8-bit YCbCr 4:2:0, an even crop, and no rotation
    is applied to its pictures; otherwise its RGB pictures as `ycbcr_frames`.
    """
    info = video.info
    if has_own_samples(video):
        return (_cut(frame, info) for frame in video.frames())
    return ycbcr_frames((shot.rgb for shot in video), info)


def has_own_samples(video: VideoReader) -> bool:
    """Return whether `source_frames` are the samples that the source has stored."""
    info = video.info
    sides = (info.width, info.height, info.crop_x, info.crop_y)
    return (
        info.pixel_format in _FOUR_TWO_ZERO
        and video.turned == (0, False)
        and not any(side % 2 for side in sides)
    )


def _cut(frame: av.VideoFrame, info: VideoInfo) -> av.VideoFrame:
    """Return the cropped part of a 4:2:0 frame, with its colour tags.

    FFmpeg's old name of full range, yuvj420p, is not one that every encoder takes.
    """
    parts = []
    for plane, factor in zip(frame.planes, (1, 2, 2), strict=True):
        samples = np.frombuffer(memoryview(plane), np.uint8).reshape(-1, plane.line_size)
        y, x = info.crop_y // factor, info.crop_x // factor
        part = samples[y : y + info.height // factor, x : x + info.width // factor]
        parts.append(part.reshape(-1))
    samples = np.concatenate(parts).reshape(-1, info.width)
    cut = av.VideoFrame.from_ndarray(samples, format="yuv420p")
    full = frame.format.name == "yuvj420p"
    cut.colorspace = frame.colorspace
    cut.color_range = ColorRange.JPEG if full else frame.color_range
    return cut
