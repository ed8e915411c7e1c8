"""Payload of a GOP chunk: head, timing, plane table, planes (spec section "GOP chunk")."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.bitstream.attribute_planes import pack_planes, unpack_planes
from gsvrcodec.bitstream.gop_head import GOP_HEAD_BYTES, GopHead, parse_gop_head
from gsvrcodec.bitstream.header import Header
from gsvrcodec.bitstream.plane_table import PlaneEntry, parse_plane_table
from gsvrcodec.bitstream.timing import pack_timing, unpack_timing
from gsvrcodec.errors import CorruptError
from gsvrcodec.limits import Limits
from gsvrcodec.model.attributes import ATTRIBUTES, SHOWN, GopShape
from gsvrcodec.model.gop import Float32Array, Gop, grid_size
from gsvrcodec.model.order import strip_order
from gsvrcodec.model.quantise import Precision
from gsvrcodec.model.time import Ticks
from gsvrcodec.planes import PACKS, Codec


@dataclass(frozen=True, slots=True, eq=False)
class GopContent:
    """Decoded content of a GOP chunk."""

    gop: Gop  #: Gaussians and deformation field
    first_frame: int  #: number of the GOP's first frame in the file
    pts: Ticks  #: (F,) presentation timestamps, ticks, strictly increasing
    durations: Ticks  #: (F,) durations, ticks, 0 = not known
    background: int = 0  #: number of the background that the GOP shows; 0 = none
    #: (Gaussians of the background,) which of them the GOP shows; None = no background
    shown: NDArray[np.bool_] | None = None


def pack_gop(
    gop: Gop,
    pts: Ticks,
    durations: Ticks,
    first_frame: int,
    precision: Precision,
    codecs: Collection[Codec] = PACKS["auto"],
    *,
    background: int = 0,
    shown: NDArray[np.bool_] | None = None,
) -> bytes:
    """Quantise, sort and code a GOP into the payload of its chunk.

    Args:
        gop: The GOP to store; all values finite.
        pts: Shape (F,), strictly increasing, ticks.
        durations: Shape (F,), ticks, 0 = not known.
        first_frame: Number of the GOP's first frame in the file.
        precision: Bits (1 to 16) of each attribute, or quantiser steps of its components.
        codecs: Plane codecs to choose from.
        background: Number of the background that the GOP shows; 0 = none.
        shown: Shape (Gaussians of the background,), which of them the GOP shows, in stored order;
            None = no background.

    Raises:
        ValueError: A value is not finite or out of the spec's bounds, or timing is inconsistent.
    """
    if not 1 <= len(pts) == len(durations):
        raise ValueError(f"{len(pts)} timestamps and {len(durations)} durations")
    shape = GopShape(len(gop), grid_size(gop), 0 if shown is None else len(shown))
    order = strip_order(gop.position)
    values: dict[str, NDArray[np.floating]] = {}
    for attribute in ATTRIBUTES:
        samples: Float32Array = getattr(gop, attribute.name)
        values[attribute.name] = samples[order] if attribute.grid == "gaussians" else samples
    if shown is not None:
        values[SHOWN.name] = shown.astype(np.float32)
    planes, data = pack_planes(values, shape, precision, codecs)
    head = GopHead(
        first_frame=first_frame,
        frames=len(pts),
        gaussians=shape.gaussians,
        start_pts=int(pts[0]),
        last_pts=int(pts[-1]),
        last_duration=int(durations[-1]),
        grid=shape.grid,
        planes=planes,
        background=background,
        background_gaussians=shape.background,
    )
    return b"".join([head.to_bytes(), pack_timing(pts, durations), data])


def unpack_gop(payload: bytes, header: Header, limits: Limits) -> GopContent:
    """Decode the payload of a GOP chunk.

    The result is without the Gaussians of the background; `append_background` adds them.

    Args:
        payload: Of the GOP chunk.
        header: Of the file; no maximum of the header may be exceeded.
        limits: Limits on the content.

    Raises:
        CorruptError: The payload breaks a rule of the spec, or exceeds a maximum of the header.
        UnsupportedError: The payload uses a codec or attribute that this version does not know.
        LimitError: The GOP is over `limits`.
    """
    head, pts, durations, entries, offset = _parse(payload, header, limits)
    shape = _shape(head)
    values = unpack_planes(entries, payload, offset, shape, limits)
    shown = values.pop(SHOWN.name, None)
    return GopContent(
        _gop(values, head),
        head.first_frame,
        pts,
        durations,
        head.background,
        None if shown is None else shown != 0,
    )


def plane_table(payload: bytes, header: Header, limits: Limits) -> tuple[PlaneEntry, ...]:
    """The plane table of a GOP chunk's payload; no plane is decoded. Raises as `unpack_gop`."""
    return _parse(payload, header, limits)[3]


def _parse(
    payload: bytes, header: Header, limits: Limits
) -> tuple[GopHead, Ticks, Ticks, tuple[PlaneEntry, ...], int]:
    """Head, timestamps, durations, plane table, and the offset of the first plane."""
    head = parse_gop_head(payload)
    head.check_maxima(header)
    limits.check("gaussians", head.most_drawn, "the number of Gaussians in a GOP")
    limits.check("gop_frames", head.frames, "the number of frames in a GOP")
    pts, durations, offset = unpack_timing(payload, GOP_HEAD_BYTES, head.start_pts, head.frames)
    if (int(pts[-1]), int(durations[-1])) != (head.last_pts, head.last_duration):
        raise CorruptError(
            f"last frame at {pts[-1]} for {durations[-1]} ticks, "
            f"the GOP's head says {head.last_pts} for {head.last_duration}"
        )
    entries, offset = parse_plane_table(payload, offset, head.planes, _shape(head).planes())
    return head, pts, durations, entries, offset


def _shape(head: GopHead) -> GopShape:
    return GopShape(head.gaussians, head.grid, head.background_gaussians)


def _gop(values: dict[str, Float32Array], head: GopHead) -> Gop:
    """The GOP of decoded values; attributes without a plane become empty arrays."""
    gx, gy, gt = head.grid
    sizes = {"gaussians": (head.gaussians,), "xy": (gy, gx), "xt": (gt, gx), "yt": (gt, gy)}
    for attribute in ATTRIBUTES:
        if attribute.name not in values:
            tail = (attribute.components,) if attribute.components > 1 else ()
            values[attribute.name] = np.empty((*sizes[attribute.grid], *tail), np.float32)
    return Gop(**{field.name: np.ascontiguousarray(values[field.name]) for field in fields(Gop)})
