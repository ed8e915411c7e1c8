"""Copies of a source's sound and subtitle streams, packet by packet, one container file each.

The containers are tried in turn; the first one that returns all packets with the same bytes and
timestamps is used, else the one with the least difference.
"""

from __future__ import annotations

import logging
import mmap
import os
import tempfile
from array import array
from collections.abc import Collection, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from fractions import Fraction
from math import lcm
from operator import ne
from pathlib import Path
from typing import Any, BinaryIO

import av
from av.audio.stream import AudioStream
from av.subtitles.stream import SubtitleStream

from gsvrcodec.bitstream.tags import StreamTags
from gsvrcodec.video.probe import demuxed, opened
from gsvrcodec.video.tags import stream_tags
from gsvrcodec.video.timing import Span

_log = logging.getLogger(__name__)

#: FFmpeg's demuxer of each container to try.
DEMUXERS = {"mp4": "mov", "mov": "mov", "matroska": "matroska", "nut": "nut"}

_MILLISECOND = Fraction(1, 1000)
_MAX_TIMESCALE = 2**31 - 1

#: Empty subtitle of MP4, which the muxer puts into every gap.
_NO_LINE = b"\0\0"

_Stream = AudioStream | SubtitleStream

#: Whether times differ by more than 1 ms, packets changed, largest time difference in seconds,
#: packets with changed side data.
_Difference = tuple[bool, int, Fraction, int]


@dataclass(frozen=True, slots=True)
class CopiedStream:
    """One copied stream of the source in a container file."""

    kind: str  #: "audio" or "subtitle"
    codec: str  #: FFmpeg's name of the codec
    tags: StreamTags
    payload: mmap.mmap  #: the container file; unmapped when nothing refers to it


def copy_streams(
    path: str | os.PathLike[str], kinds: Collection[str], span: Span
) -> Iterator[CopiedStream]:
    """Yield copies of the streams of the chosen kinds, in source order.

    Args:
        path: Any file that FFmpeg reads.
        kinds: "audio", "subtitle" or both.
        span: Packets outside the span are left out; timestamps do not change.

    Raises:
        InputError: The file cannot be read.
    """
    path = Path(path)
    with opened(path) as (container, _), ExitStack() as files:
        indices = [stream.index for stream in container.streams if stream.type in kinds]
        copies: dict[int, _TrialCopy] = {}
        for choice in range(len(DEMUXERS)):
            left = [index for index in indices if index not in copies or not copies[index].exact]
            for index, copy in _attempt(path, left, choice, span, files).items():
                if index not in copies or copy.difference < copies[index].difference:
                    copies[index] = copy
        for index in indices:
            if index not in copies:
                kind = container.streams[index].type
                _log.warning("%s: stream %d (%s) cannot be copied: left out", path, index, kind)
            elif copies[index].packets:
                yield copies[index].result()


def _attempt(
    path: Path, indices: list[int], choice: int, span: Span, files: ExitStack
) -> dict[int, _TrialCopy]:
    """Copy each stream into the container number `choice` of its list; return the successes."""
    copies: dict[int, _TrialCopy] = {}
    if not indices:
        return copies
    with opened(path) as (container, _):
        for index in indices:
            stream = container.streams[index]
            assert isinstance(stream, AudioStream | SubtitleStream)
            try:
                file = files.enter_context(tempfile.TemporaryFile())  # noqa: SIM115, the stack closes it
                copies[index] = _TrialCopy(stream, _order(stream)[choice], file)
            except (av.FFmpegError, ValueError) as error:
                _log.debug("stream %d: %s", index, error)
        wanted = [container.streams[index] for index in copies]
        for packet in demuxed(container, wanted):
            copy = copies.get(packet.stream.index)
            if copy is not None and place(packet, span):
                try:
                    copy.add(packet)
                except (av.FFmpegError, ValueError) as error:
                    _log.debug("stream %d: %s", packet.stream.index, error)
                    del copies[packet.stream.index]
        return {index: copy for index, copy in copies.items() if copy.finish()}


def _order(stream: _Stream) -> list[str]:
    """Return the containers to try for a stream, the likeliest first."""
    names = list(DEMUXERS)
    if stream.time_base == _MILLISECOND:  # as in Matroska files
        names.sort(key=lambda name: name != "matroska")
    return names


def place(packet: av.Packet[_Stream], span: Span) -> bool:
    """Return whether a packet overlaps the span; a subtitle is clipped to the span."""
    pts = packet.dts if packet.pts is None else packet.pts
    if pts is None:
        return True  # no container accepts it: the copy then fails
    base, duration = packet.time_base, packet.duration or 0
    if not span.overlaps(pts * base, (pts + duration) * base):
        return False
    if packet.stream.type == "subtitle" and duration:
        start, stop = span.clipped(pts * base, (pts + duration) * base)
        packet.pts = packet.dts = round(start / base)
        packet.duration = round(stop / base) - packet.pts
    return True


class _TrialCopy:
    """Trial copy of one stream into a container in a temporary file."""

    def __init__(self, stream: _Stream, container: str, file: BinaryIO) -> None:
        """Open a `container` for packets of `stream` in `file`.

        Raises:
            FFmpegError, ValueError: The container does not support the codec.
        """
        self._kind, self._codec = stream.type, stream.codec_context.name
        self._tags = stream_tags(stream)
        self._demuxer = DEMUXERS[container]
        self._file = file
        options = {"fflags": "+bitexact"}  # reproducible bytes
        if container == "matroska":
            options["avoid_negative_ts"] = "disabled"
        if container in ("mp4", "mov") and stream.time_base is not None:
            options["movie_timescale"] = str(min(stream.time_base.denominator, _MAX_TIMESCALE))
        self._output = av.open(self._file, "w", format=container, container_options=options)
        self._stream = self._output.add_stream_from_template(stream)
        self._output.start_encoding()
        self.packets = _Packets(stream.time_base or _MILLISECOND)
        self.difference: _Difference = (False, 0, Fraction(0), 0)

    @property
    def exact(self) -> bool:
        """Whether the container returned all packets unchanged."""
        return not any(self.difference)

    def add(self, packet: av.Packet[_Stream]) -> None:
        """Write a packet; raises as `av` if the container rejects it."""
        self.packets.add(packet)
        packet.stream = self._stream
        self._output.mux(packet)

    def finish(self) -> bool:
        """Close the container, read it back and compare; return whether all packets came back."""
        if not self.packets:
            return True
        try:
            self._output.close()
            self._file.seek(0)
            with av.open(self._file, "r", format=self._demuxer) as container:
                stream = container.streams[0]
                found = _Packets(stream.time_base or _MILLISECOND)
                for packet in demuxed(container, [stream]):
                    found.add(packet)
        except (av.FFmpegError, ValueError) as error:
            _log.debug("a copied stream cannot be read back: %s", error)
            return False
        self.difference = _difference(self._kind, self.packets, found)
        return len(found) == len(self.packets)

    def result(self) -> CopiedStream:
        """Return the copied stream; warn of differences from the source."""
        out_of_step, changed, _, _ = self.difference
        if out_of_step:
            _log.warning("a stream of %s is kept out of step with the picture", self._codec)
        if changed:
            _log.warning("a stream of %s is kept in another form than its source's", self._codec)
        payload = mmap.mmap(self._file.fileno(), 0, access=mmap.ACCESS_READ)
        return CopiedStream(self._kind, self._codec, self._tags, payload)


class _Packets:
    """Hashes and times of the packets of a stream, a few bytes a packet."""

    def __init__(self, base: Fraction) -> None:
        """Start empty; `base` is seconds a tick."""
        self.base = base
        self.data = array("q")  #: hash of a packet's bytes
        self.extras = array("q")  #: hash of a packet's side data, such as samples to skip
        self.start = array("q")  #: ticks
        self.duration = array("q")  #: ticks

    def __len__(self) -> int:
        """Return the number of packets."""
        return len(self.data)

    def add(self, packet: av.Packet[Any]) -> None:
        """Add a packet."""
        content = bytes(packet)
        if content == _NO_LINE and packet.stream.codec_context.name == "mov_text":
            return
        sides = tuple((side.data_type, bytes(side)) for side in packet.iter_sidedata())
        self.data.append(hash(content))
        self.extras.append(hash(sides))
        self.start.append((packet.dts if packet.pts is None else packet.pts) or 0)
        self.duration.append(packet.duration or 0)


def _difference(kind: str, old: _Packets, new: _Packets) -> _Difference:
    """Return the difference between two copies of a stream, the gravest part first.

    Durations count for subtitles only: the duration of audio follows from its samples.
    """
    fine = Fraction(1, lcm(old.base.denominator, new.base.denominator))
    old_scale, new_scale = int(old.base / fine), int(new.base / fine)
    pairs = list(zip(old.start, new.start, strict=False))
    if kind == "subtitle":
        pairs += zip(old.duration, new.duration, strict=False)
    off = max((abs(a * old_scale - b * new_scale) for a, b in pairs), default=0) * fine
    return (
        off > _MILLISECOND,
        sum(map(ne, old.data, new.data)),
        off,
        sum(map(ne, old.extras, new.extras)),
    )
