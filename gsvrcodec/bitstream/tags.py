"""The chunks `meta`, of titles, languages and chapters, and `sett` (spec "Auxiliary chunks")."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any, Literal

from gsvrcodec.errors import CorruptError, spec_section


@dataclass(frozen=True, slots=True)
class Chapter:
    """A chapter of the film."""

    start: Fraction  #: seconds, on the clock of the frames' timestamps; included
    stop: Fraction  #: seconds; not included
    tags: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class StreamTags:
    """Tags of one stream of the source."""

    tags: Mapping[str, str] = field(default_factory=dict)  #: language, title and so on
    disposition: int = 0  #: FFmpeg's disposition flags: 1 = default, 64 = forced, ...


@dataclass(frozen=True, slots=True)
class Tags:
    """Tags of the source: of the film, of its streams, of its chapters."""

    film: Mapping[str, str] = field(default_factory=dict)  #: of the whole film: title, artist, ...
    video: StreamTags = field(default_factory=StreamTags)
    streams: tuple[StreamTags, ...] = ()  #: one for each chunk `strm`, in file order
    chapters: tuple[Chapter, ...] = ()

    def to_bytes(self) -> bytes:
        """The payload of the chunk `meta`."""
        return json.dumps(
            {
                "film": dict(self.film),
                "video": _stream_to_json(self.video),
                "streams": [_stream_to_json(stream) for stream in self.streams],
                "chapters": [
                    {
                        "start": [part.start.numerator, part.start.denominator],
                        "stop": [part.stop.numerator, part.stop.denominator],
                        "tags": dict(part.tags),
                    }
                    for part in self.chapters
                ],
            },
            ensure_ascii=False,
        ).encode()


@spec_section("10")
def parse_settings(payload: bytes) -> dict[str, Any]:
    """Parse the payload of a chunk `sett`.

    Raises:
        CorruptError: The payload is not a JSON object.
    """
    try:
        value = json.loads(payload.decode("utf-8"))
    except (ValueError, RecursionError):
        value = None
    if not isinstance(value, dict):
        raise CorruptError("not a JSON object in UTF-8", chunk="sett")
    return value


@spec_section("10")
def parse_tags(payload: bytes) -> Tags:
    """Parse the payload of a chunk `meta`.

    Raises:
        CorruptError: The payload is not JSON, or the value of a known key has another type.
    """
    try:
        value = json.loads(payload.decode("utf-8"))
        return Tags(
            film=_strings(value.get("film", {})),
            video=_stream_from_json(value.get("video", {})),
            streams=tuple(_stream_from_json(stream) for stream in value.get("streams", [])),
            chapters=tuple(
                Chapter(Fraction(*part["start"]), Fraction(*part["stop"]), _strings(part["tags"]))
                for part in value.get("chapters", [])
            ),
        )
    except (ValueError, TypeError, KeyError, AttributeError, ArithmeticError, RecursionError):
        raise CorruptError("metadata that does not keep to the format", chunk="meta") from None


def _stream_to_json(stream: StreamTags) -> dict[str, Any]:
    return {"tags": dict(stream.tags), "disposition": stream.disposition}


def _stream_from_json(value: dict[str, Any]) -> StreamTags:
    disposition = value.get("disposition", 0)
    if not isinstance(disposition, int) or not 0 <= disposition < 2**31:
        raise ValueError("a disposition is a set of flags")
    return StreamTags(_strings(value.get("tags", {})), disposition)


def _strings(value: Any) -> dict[str, str]:
    """Return `value` if it maps strings to strings, else raise a ValueError."""
    if not all(isinstance(text, str) for pair in value.items() for text in pair):
        raise ValueError("tags are text")
    return dict(value)


def container_of(payload: bytes) -> Literal["mp4", "matroska", "nut"]:
    """Return the container of a copied stream, by its first bytes.

    Raises:
        CorruptError: It is another one.
    """
    if payload[4:8] == b"ftyp":
        return "mp4"
    if payload.startswith(b"\x1aE\xdf\xa3"):
        return "matroska"
    if payload.startswith(b"nut/multimedia container\0"):
        return "nut"
    raise CorruptError("it is neither MP4 nor Matroska nor NUT", section="10")
