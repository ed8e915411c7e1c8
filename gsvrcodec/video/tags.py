"""Titles, languages and chapters: from a source, and into an output."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction

from av.container import InputContainer, OutputContainer
from av.stream import Disposition, Stream
from av.video.stream import VideoStream

from gsvrcodec.bitstream.tags import Chapter, StreamTags, Tags
from gsvrcodec.video.timing import Span

#: What is true of the source's container only, and what every muxer writes anew.
_CONTAINER_TAGS = frozenset(
    {"major_brand", "minor_version", "compatible_brands", "encoder", "vendor_id", "duration"}
)

#: Statistics that Matroska files carry of their streams.
_STATISTICS = ("bps", "number_of_", "_statistics_", "duration-")

#: Chapters are written in nanoseconds, as Matroska counts.
_NANOSECOND = Fraction(1, 10**9)


def source_tags(container: InputContainer, video: VideoStream, span: Span) -> Tags:
    """Return what a source says about itself, chapters within `span` only."""
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
    """Return what a source says about one of its streams."""
    tags = _meaningful(stream.metadata)
    if "name" in tags:  # what MP4 calls it
        tags.setdefault("title", tags.pop("name"))
    return StreamTags(tags, int(stream.disposition))


def write_tags(tags: Tags, container: OutputContainer, video: VideoStream, span: Span) -> None:
    """Put tags into an output, before its first packet; chapters within `span` only."""
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
    """Put tags into a stream of an output, before its first packet."""
    stream.metadata.update(tags.tags)
    stream.disposition = Disposition(tags.disposition)


def _meaningful(tags: Mapping[str, str]) -> dict[str, str]:
    """Return the tags that say something about the content."""
    return {
        key: value
        for key, value in tags.items()
        if key.lower() not in _CONTAINER_TAGS and not key.lower().startswith(_STATISTICS)
    }


def _within(chapters: tuple[Chapter, ...], span: Span) -> tuple[Chapter, ...]:
    """Return the parts of the chapters that lie in `span`."""
    return tuple(
        Chapter(*span.clipped(part.start, part.stop), part.tags)
        for part in chapters
        if span.overlaps(part.start, part.stop)
    )
