"""Deinterlacing by FFmpeg's bwdif filter."""

from __future__ import annotations

from collections.abc import Iterator

import av
import av.filter
from av.video.stream import VideoStream


def deinterlaced(frames: Iterator[av.VideoFrame], stream: VideoStream) -> Iterator[av.VideoFrame]:
    """Yield frames at their own timestamps; interlaced frames are deinterlaced."""
    graph = av.filter.Graph()
    source = graph.add_buffer(template=stream)
    bwdif = graph.add("bwdif", "mode=send_frame:deint=interlaced")
    sink = graph.add("buffersink")
    source.link_to(bwdif)
    bwdif.link_to(sink)
    graph.configure()
    for frame in frames:
        source.push(frame)
        yield from _ready(sink, stream)
    source.push(None)
    yield from _ready(sink, stream)


def _ready(sink: av.filter.FilterContext, stream: VideoStream) -> Iterator[av.VideoFrame]:
    """Yield the filtered frames, with timestamps in ticks of the stream."""
    while True:
        try:
            frame = sink.pull()
        except (av.BlockingIOError, av.EOFError):
            return
        assert isinstance(frame, av.VideoFrame)
        if stream.time_base is not None and frame.time_base is not None:
            scale = frame.time_base / stream.time_base
            frame.pts = None if frame.pts is None else round(frame.pts * scale)
            frame.duration = round(frame.duration * scale)
            frame.time_base = stream.time_base
        yield frame
