"""Titles, languages and chapters: read from a source, written to an output."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction

from av.container import InputContainer, OutputContainer
from av.stream import Disposition, Stream
from av.video.stream import VideoStream

from gsvrcodec.bitstream.tags import Chapter, StreamTags, Tags
from gsvrcodec.video.timing import Span

#: Tags that describe the source's container, or that every muxer writes itself.
_CONTAINER_TAGS = frozenset(
    {"major_brand", "minor_version", "compatible_brands", "encoder", "vendor_id", "duration"}
)

#: Prefixes of statistics tags in Matroska files.
_STATISTICS = ("bps", "number_of_", "_statistics_", "duration-")

#: Tick of written chapters, as in Matroska, seconds.
_NANOSECOND = Fraction(1, 10**9)


def source_tags(container: InputContainer, video: VideoStream, span: Span) -> Tags:
    """Return the tags of a source, with chapters clipped to `span`."""
    return Tags(
        film=_meaningful(container.metadata),
        video=stream_tags(video),
        chapters=_within(
            tuple(
                Chapter(
                    part["start"] * (part["time_base"] or _NANOSECOND),
                    part["end"] * (part["time_base"] or _NANOSECOND),
                    _meaningful(part["metadata"]),
                )
                for part in container.chapters()
            ),
            span,
        ),
    )


def stream_tags(stream: Stream) -> StreamTags:
    """Return the tags of one stream of a source."""
    tags = _meaningful(stream.metadata)
    if "name" in tags:  # MP4's name of the title
        tags.setdefault("title", tags.pop("name"))
    return StreamTags(tags, int(stream.disposition))


def write_tags(tags: Tags, container: OutputContainer, video: VideoStream, span: Span) -> None:
    """Write tags to an output, before its first packet, with chapters clipped to `span`."""
    container.metadata.update(tags.film)
    write_stream_tags(tags.video, video)
    container.set_chapters(
        [
            {
                "id": number,
                "start": round(part.start / _NANOSECOND),
                "end": round(part.stop / _NANOSECOND),
                "time_base": _NANOSECOND,
                "metadata": dict(part.tags),
            }
            for number, part in enumerate(_within(tags.chapters, span), 1)
        ]
    )


def write_stream_tags(tags: StreamTags, stream: Stream) -> None:
    """Write tags to a stream of an output, before its first packet."""
    stream.metadata.update(tags.tags)
    stream.disposition = Disposition(tags.disposition)


def _meaningful(tags: Mapping[str, str]) -> dict[str, str]:
    """Return the tags that describe the content, not the container."""
    return {
        key: value
        for key, value in tags.items()
        if key.lower() not in _CONTAINER_TAGS and not key.lower().startswith(_STATISTICS)
    }


def _within(chapters: tuple[Chapter, ...], span: Span) -> tuple[Chapter, ...]:
    """Return the chapters that overlap `span`, clipped to it."""
    return tuple(
        Chapter(*span.clipped(part.start, part.stop), part.tags)
        for part in chapters
        if span.overlaps(part.start, part.stop)
    )
