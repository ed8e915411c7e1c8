"""Plane table: attribute, codec, quantiser and size of each plane (spec "Plane table")."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from gsvrcodec.bitstream.plane_entries import CodedEntry, take_entries
from gsvrcodec.errors import CorruptError, UnsupportedError, spec_section
from gsvrcodec.model.attributes import MODE, Attribute
from gsvrcodec.model.quantise import MODE_QUANTISER, Quantiser, step_number, step_of
from gsvrcodec.planes.table import Codec

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
        """The bytes of the entry."""
        bits, first, step = self.quantiser
        return CodedEntry(self.codec, bits, step_number(step), first, self.size).to_bytes()


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
        CorruptError: The table is cut short, or breaks a rule.
        UnsupportedError: An entry has a codec that this version does not know.
    """
    coded, end = take_entries(payload, offset, planes)
    for entry in coded:
        if entry.codec not in _CODECS:
            raise UnsupportedError(f"unknown plane codec {entry.codec}")
    if planes != len(expected):
        raise CorruptError(f"{planes} planes, expected {len(expected)}")
    entries = tuple(
        PlaneEntry(attribute, part, _CODECS[of.codec], _quantiser(of, attribute), w, h, of.size)
        for of, (attribute, part, w, h) in zip(coded, expected, strict=True)
    )
    last = end + sum(entry.size for entry in entries)
    if last > len(payload):
        raise CorruptError(f"planes end at byte {last} of a payload of {len(payload)} bytes")
    return entries, end


def _quantiser(entry: CodedEntry, attribute: Attribute) -> Quantiser:
    quantiser = Quantiser(entry.bits, entry.first, step_of(entry.step))
    if attribute is MODE and quantiser != MODE_QUANTISER:
        raise CorruptError(
            f"plane mode of {entry.bits} bits from {quantiser.offset:g} in steps of "
            f"{quantiser.step:g}"
        )
    if quantiser.offset < attribute.low or quantiser.last > attribute.high:
        raise CorruptError(
            f"plane {attribute.name} spans {quantiser.offset:g} to {quantiser.last:g}, "
            f"allowed is {attribute.low:g} to {attribute.high:g}"
        )
    return quantiser
