"""Plane table: attribute, codec, quantiser and size of each plane (spec "Plane table")."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from typing import NamedTuple

from gsvrcodec.bitstream.plane_codecs import PLANE_ENTRY
from gsvrcodec.errors import CorruptError, UnsupportedError, spec_section
from gsvrcodec.model.attributes import ATTRIBUTE_BY_ID, MODE, Attribute
from gsvrcodec.model.quantise import MODE_QUANTISER, Quantiser
from gsvrcodec.planes.samples import MAX_BITS
from gsvrcodec.planes.table import Codec

PLANE_ENTRY_BYTES = PLANE_ENTRY.size
_CODECS = {codec.value: codec for codec in Codec}


class PlaneEntry(NamedTuple):
    """One entry of the plane table."""

    attribute: Attribute  #: attribute that the plane belongs to
    component: int  #: component of the attribute, from 0
    codec: Codec  #: plane codec
    quantiser: Quantiser  #: bits, offset and step of the samples
    width: int  #: samples in a row
    height: int  #: rows
    size: int  #: bytes of the coded plane

    @property
    def name(self) -> str:
        """Attribute and component, as in "colour.2"; for messages and tables."""
        if self.attribute.components == 1:
            return self.attribute.name
        return f"{self.attribute.name}.{self.component}"

    def to_bytes(self) -> bytes:
        """The 16 bytes of the entry."""
        return PLANE_ENTRY.pack(
            self.attribute.id,
            self.component,
            self.codec,
            self.quantiser.bits,
            self.quantiser.offset,
            self.quantiser.step,
            self.size,
        )


@spec_section("5.3")
def parse_plane_table(
    payload: bytes,
    offset: int,
    planes: int,
    expected: Sequence[tuple[Attribute, int, int, int]],
) -> tuple[tuple[PlaneEntry, ...], int]:
    """Parse a plane table, and check that the planes behind the table end with the payload.

    Args:
        payload: Payload of a GOP chunk.
        offset: Byte offset of the table in the payload.
        planes: Number of entries by the payload's head.
        expected: Required entries: attribute, component, width, height.

    Returns:
        The entries, and the byte offset after the table.

    Raises:
        CorruptError: The table is cut short, or differs from `expected`.
        UnsupportedError: An entry has an attribute or codec that this version does not know.
    """
    end = offset + planes * PLANE_ENTRY_BYTES
    if end > len(payload):
        raise CorruptError(f"plane table of {planes} planes cut short")
    raw = list(PLANE_ENTRY.iter_unpack(payload[offset:end]))
    for attribute_id, _, codec, *_ in raw:
        if attribute_id not in ATTRIBUTE_BY_ID:
            raise UnsupportedError(f"unknown attribute {attribute_id} in a plane table")
        if codec not in _CODECS:
            raise UnsupportedError(f"unknown plane codec {codec}")
    if len(raw) != len(expected):
        raise CorruptError(f"{len(raw)} planes, expected {len(expected)}")
    entries = []
    for fields, (attribute, component, width, height) in zip(raw, expected, strict=True):
        attribute_id, part, codec, bits, start, step, size = fields
        if (attribute_id, part) != (attribute.id, component):
            raise CorruptError(
                f"plane {attribute_id}.{part} where {attribute.id}.{component} is expected"
            )
        quantiser = _quantiser(attribute, codec, bits, start, step)
        entries.append(
            PlaneEntry(attribute, component, _CODECS[codec], quantiser, width, height, size)
        )
    last = end + sum(entry.size for entry in entries)
    if last > len(payload):
        raise CorruptError(f"planes end at byte {last} of a payload of {len(payload)} bytes")
    return tuple(entries), end


def _quantiser(
    attribute: Attribute, codec: int, bits: int, offset: float, step: float
) -> Quantiser:
    if not 1 <= bits <= MAX_BITS:
        raise CorruptError(f"plane {attribute.name} of {bits} bits")
    if not (isfinite(offset) and isfinite(step)) or step < 0:
        raise CorruptError(f"plane {attribute.name} with offset {offset} and step {step}")
    if step == 0 and codec != Codec.CONSTANT:
        raise CorruptError(f"plane {attribute.name} with step 0 is not constant")
    quantiser = Quantiser(bits, offset, step)
    if attribute is MODE and quantiser != MODE_QUANTISER:
        raise CorruptError(f"plane mode of {bits} bits with offset {offset:g} and step {step:g}")
    if offset < attribute.low or quantiser.last > attribute.high:
        raise CorruptError(
            f"plane {attribute.name} spans {offset:g} to {quantiser.last:g}, "
            f"allowed is {attribute.low:g} to {attribute.high:g}"
        )
    return quantiser
