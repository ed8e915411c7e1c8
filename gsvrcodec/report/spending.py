"""Bytes of a .gsvr file by purpose; no plane is decoded."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass
from typing import Any

from gsvrcodec.bitstream.chunk import (
    GOP_TYPE,
    METADATA_TYPE,
    OVERHEAD_BYTES,
    SETTINGS_TYPE,
    SIGNATURE,
    STREAMS_TYPE,
    STRUCTURAL_TYPES,
)
from gsvrcodec.bitstream.gop_payload import plane_table
from gsvrcodec.bitstream.plane_table import PlaneEntry
from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.errors import CorruptError, UnsupportedError
from gsvrcodec.limits import Limits
from gsvrcodec.model.attributes import ALL_ATTRIBUTES

_NAMES = {
    SETTINGS_TYPE: "settings",
    METADATA_TYPE: "metadata",
    STREAMS_TYPE: "streams",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Item:
    """Bytes of one purpose."""

    name: str
    bytes: int  #: bytes in the whole file
    bits_per_gaussian: float | None  #: None = the file has no Gaussians
    codecs: tuple[str, ...] = ()  #: codecs of its planes

    def to_dict(self) -> dict[str, Any]:
        """Return the item as a dictionary, without the name."""
        return {key: value for key, value in asdict(self).items() if key != "name"}


def spending(reader: GsvrReader, limits: Limits | None = None) -> tuple[Item, ...]:
    """Return the bytes of a file by purpose; the items add up to the file size.

    The items are: each attribute, in the order of the spec, over all GOPs, so those of carried
    Gaussians stand for themselves; "refinement" of the values of new Gaussians; "plates"; "heads",
    the heads, timing and plane tables of GOPs; the auxiliary chunks; "container", signature,
    header, index, end and chunk framing; "unread", payloads that are damaged or not supported by
    this version.
    Empty items are left out.

    Raises:
        InputError: The file cannot be read.
    """
    limits = limits or Limits.from_environment()
    sizes: dict[str, int] = {attribute.name: 0 for attribute in ALL_ATTRIBUTES}
    codecs: dict[str, set[str]] = {}
    sizes |= dict.fromkeys(("refinement", "plates", "heads", "settings", "metadata", "streams"), 0)
    sizes |= dict.fromkeys(("other", "container", "unread"), 0)
    sizes["container"] = len(SIGNATURE) + OVERHEAD_BYTES * len(reader.chunks)
    for chunk in reader.chunks:
        if chunk.type in STRUCTURAL_TYPES - {GOP_TYPE}:
            sizes["container"] += chunk.size
        elif chunk.type != GOP_TYPE:
            sizes[_NAMES.get(chunk.type, "other")] += chunk.size
    for size, entries, offset, plate in _tables(reader, limits):
        sizes["plates"] += plate
        sizes["heads"] += offset - plate
        sizes["refinement"] += size - offset - sum(entry.size for entry in entries)
        for entry in entries:
            name = entry.attribute.name
            sizes[name] += entry.size
            codecs.setdefault(name, set()).add(entry.codec.name.lower())
    sizes["unread"] = reader.size - sum(sizes.values())
    gaussians = reader.gaussians
    return tuple(
        Item(
            name=name,
            bytes=size,
            bits_per_gaussian=8 * size / gaussians if gaussians else None,
            codecs=tuple(sorted(codecs.get(name, ()))),
        )
        for name, size in sizes.items()
        if size
    )


def _tables(
    reader: GsvrReader, limits: Limits
) -> Iterator[tuple[int, tuple[PlaneEntry, ...], int, int]]:
    """Yield size, plane table, offset of the first plane, and bytes of the plate of valid GOPs."""
    for position in range(len(reader.gops)):
        with suppress(CorruptError, UnsupportedError):
            payload = reader.read_gop(position)
            yield len(payload), *plane_table(payload, reader.header, limits)
