"""Copied streams of a .gsvr file, remuxed into the container of the output."""

from __future__ import annotations

import io
import logging
from collections.abc import Sequence
from fractions import Fraction
from itertools import islice
from math import lcm
from typing import Any

import av
from av.container import InputContainer, OutputContainer
from av.stream import Stream

from gsvrcodec.bitstream.tags import StreamTags, container_of
from gsvrcodec.video.probe import demuxed
from gsvrcodec.video.streams import DEMUXERS, place
from gsvrcodec.video.tags import write_stream_tags
from gsvrcodec.video.timing import Span

_log = logging.getLogger(__name__)


class StreamCopies:
    """Remuxes copied streams into one output, interleaved with the video."""

    def __init__(self, streams: Sequence[tuple[StreamTags, bytes]], span: Span) -> None:
        """Open the streams.

        Args:
            streams: Tags of each stream, and a container file with that stream alone, as from
                `copy_streams`.
            span: Packets outside the span are left out.
        """
        self._copies: list[_StoredStream] = []
        for tags, payload in streams:
            try:
                self._copies.append(_StoredStream(payload, tags, span))
            except (av.FFmpegError, ValueError, IndexError) as error:
                _log.warning("a copied stream cannot be read and is left out: %s", error)

    def timescale(self, video: int, largest: int) -> int:
        """Return the timescale common to video and streams; `video` if it is over `largest`."""
        common = lcm(video, *(copy.rate for copy in self._copies))
        return common if common <= largest else video

    def add_to(self, output: OutputContainer) -> None:
        """Add the streams to an output, before its first packet; warn of unsupported streams."""
        refused = [copy for copy in self._copies if not copy.fits(output.format.name)]
        if refused:
            what = ", ".join(copy.description for copy in refused)
            _log.warning("%s cannot hold these streams: %s; left out", output.format.name, what)
        self._copies = [copy for copy in self._copies if copy not in refused]
        for copy in self._copies:
            copy.add_to(output)

    def write(self, until: Fraction | None = None) -> None:
        """Write the packets before `until` seconds; None = all remaining packets."""
        for copy in self._copies:
            copy.write(until)

    def close(self) -> None:
        """Close the container files of the streams."""
        for copy in self._copies:
            copy.close()


class _StoredStream:
    """One copied stream in its container file."""

    def __init__(self, payload: bytes, tags: StreamTags, span: Span) -> None:
        self._payload = payload
        self._container = _opened(payload)
        self._source = self._container.streams[0]
        if self._source.type not in ("audio", "subtitle") or self._source.codec_context is None:
            raise ValueError(f"a stream of {self._source.type} that is not known")
        self._tags = tags
        self._packets = (
            packet for packet in demuxed(self._container, [self._source]) if place(packet, span)
        )
        self._next = next(self._packets, None)
        self._output: OutputContainer | None = None
        self._target: Stream | None = None

    @property
    def description(self) -> str:
        """Type and codec of the stream, for messages."""
        return f"{self._source.type} ({self._source.codec_context.name})"

    @property
    def rate(self) -> int:
        """Timescale of the stream, ticks a second."""
        base = self._source.time_base
        return base.denominator if base else 1

    def fits(self, container: str) -> bool:
        """Return whether a container takes the stream, by a trial with its first packet."""
        try:
            with (
                _opened(self._payload) as source,
                av.open(io.BytesIO(), "w", format=container) as trial,
            ):
                target = trial.add_stream_from_template(source.streams[0])
                trial.start_encoding()
                for packet in islice(demuxed(source, [source.streams[0]]), 1):
                    packet.stream = target
                    trial.mux(packet)
        except (av.FFmpegError, ValueError) as error:
            _log.debug("%s: %s", self.description, error)
            return False
        return True

    def add_to(self, output: OutputContainer) -> None:
        """Add the stream to an output, unless the stream has no packet."""
        if self._next is not None:
            self._output = output
            self._target = output.add_stream_from_template(self._source)
            write_stream_tags(self._tags, self._target)

    def write(self, until: Fraction | None) -> None:
        """Write the packets before `until` seconds; None = all remaining packets."""
        while self._next is not None and (until is None or _start(self._next) < until):
            packet, self._next = self._next, next(self._packets, None)
            assert self._output is not None
            assert self._target is not None
            packet.stream = self._target
            try:
                self._output.mux(packet)
            except av.FFmpegError as error:
                _log.warning("%s breaks off: %s", self.description, error.strerror)
                self._next = None

    def close(self) -> None:
        """Close the container file."""
        self._container.close()


def _start(packet: av.Packet[Any]) -> Fraction:
    """Return the decoding timestamp of a packet, seconds."""
    ticks = packet.pts if packet.dts is None else packet.dts
    return (ticks or 0) * packet.time_base


def _opened(payload: bytes) -> InputContainer:
    """Open the container file of one stream; no other demuxer may read its bytes."""
    return av.open(io.BytesIO(payload), "r", format=DEMUXERS[container_of(payload)])
