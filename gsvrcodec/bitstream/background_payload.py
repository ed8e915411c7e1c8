"""Payload of a background chunk: head, plane table, planes (spec "Background chunk")."""

from __future__ import annotations

from collections.abc import Collection

from gsvrcodec.bitstream.attribute_planes import pack_planes, unpack_planes
from gsvrcodec.bitstream.background_head import (
    BACKGROUND_HEAD_BYTES,
    BackgroundHead,
    parse_background_head,
)
from gsvrcodec.bitstream.plane_table import PlaneEntry, parse_plane_table
from gsvrcodec.limits import Limits
from gsvrcodec.model.attributes import STATIC_ATTRIBUTES, GopShape
from gsvrcodec.model.background import Background, static_gop
from gsvrcodec.model.gop import Gop
from gsvrcodec.model.order import strip_order
from gsvrcodec.model.quantise import Precision
from gsvrcodec.planes import PACKS, Codec

_GRID = (0, 0, 0)


def pack_background(
    number: int, gop: Gop, precision: Precision, codecs: Collection[Codec] = PACKS["auto"]
) -> bytes:
    """Quantise, sort and code a background into the payload of its chunk.

    Args:
        number: Number by which GOPs refer to the background, from 1.
        gop: The Gaussians, at least one; motion and tri-plane are ignored.
        precision: Bits of each attribute, or quantiser steps of its components.
        codecs: Plane codecs to choose from.

    Raises:
        ValueError: A value is not finite or out of the spec's bounds.
    """
    order = strip_order(gop.position)
    values = {a.name: getattr(gop, a.name)[order] for a in STATIC_ATTRIBUTES}
    shape = GopShape(len(gop), _GRID)
    planes, data = pack_planes(values, shape, precision, codecs, STATIC_ATTRIBUTES)
    return BackgroundHead(number, len(gop), planes).to_bytes() + data


def unpack_background(payload: bytes, limits: Limits) -> Background:
    """Decode the payload of a background chunk.

    Raises:
        CorruptError: The payload breaks a rule of the spec.
        UnsupportedError: The payload uses a codec or attribute that this version does not know.
        LimitError: The background is over `limits`.
    """
    head, entries, offset = _parse(payload, limits)
    shape = GopShape(head.gaussians, _GRID)
    values = unpack_planes(entries, payload, offset, shape, limits, STATIC_ATTRIBUTES)
    return Background(head.number, static_gop(**values))


def background_table(payload: bytes, limits: Limits) -> tuple[PlaneEntry, ...]:
    """The plane table of a background chunk's payload; no plane is decoded.

    Raises as `unpack_background`.
    """
    return _parse(payload, limits)[1]


def _parse(payload: bytes, limits: Limits) -> tuple[BackgroundHead, tuple[PlaneEntry, ...], int]:
    """Head, plane table, and the offset of the first plane."""
    head = parse_background_head(payload)
    limits.check("gaussians", head.gaussians, "the number of Gaussians in a background")
    expected = GopShape(head.gaussians, _GRID).planes(STATIC_ATTRIBUTES)
    entries, offset = parse_plane_table(payload, BACKGROUND_HEAD_BYTES, head.planes, expected)
    return head, entries, offset
