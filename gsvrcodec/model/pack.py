"""A GOP as bytes and back: head, timing, plane table, planes (spec section "GOP chunk")."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.container.gop_head import GOP_HEAD_BYTES, GopHead, parse_gop_head
from gsvrcodec.container.header import Header
from gsvrcodec.errors import CorruptError
from gsvrcodec.limits import Limits
from gsvrcodec.model.attributes import ATTRIBUTES, Attribute, Grid, expected_planes, plane_size
from gsvrcodec.model.gop import Float32Array, Gop
from gsvrcodec.model.order import strip_order
from gsvrcodec.model.plane_table import PlaneEntry, parse_plane_table
from gsvrcodec.model.quantise import Precision, Quantiser
from gsvrcodec.model.timing import Ticks, pack_timing, unpack_timing
from gsvrcodec.planes import PACKS, Codec, PlaneStack, decode_plane, encode_plane


@dataclass(frozen=True, slots=True, eq=False)
class GopContent:
    """What a GOP chunk holds."""

    gop: Gop  #: its Gaussians and their deformation
    first_frame: int  #: number of its first frame in the file
    pts: Ticks  #: (F,) presentation timestamps, ticks, strictly increasing
    durations: Ticks  #: (F,) durations, ticks, 0 = not known


def pack_gop(
    gop: Gop,
    pts: Ticks,
    durations: Ticks,
    first_frame: int,
    precision: Precision,
    codecs: Collection[Codec] = PACKS["auto"],
) -> bytes:
    """Quantise, sort and code a GOP into the payload of its chunk.

    Args:
        gop: What to store; all values finite.
        pts: Shape (F,), strictly increasing, ticks.
        durations: Shape (F,), ticks, 0 = not known.
        first_frame: Number of its first frame in the file.
        precision: Bits of each attribute (1 to 16), or steps of its components.
        codecs: Plane codecs to choose from.

    Raises:
        ValueError: A value is not finite or out of the spec's bounds, or timing is inconsistent.
    """
    if not 1 <= len(pts) == len(durations):
        raise ValueError(f"{len(pts)} timestamps and {len(durations)} durations")
    gaussians, grid = len(gop), grid_size(gop)
    order = strip_order(gop.position)
    table: list[bytes] = []
    planes: list[bytes] = []
    stacks = _plane_stacks(gaussians, grid)
    for attribute, part, width, height in expected_planes(gaussians, grid):
        values = _component(gop, attribute, part)
        quantiser = _quantiser(values, attribute, part, precision)
        if attribute.grid == "gaussians":
            # The last Gaussian again in the cells that N does not fill; decoders drop them.
            values = np.pad(values[order], (0, width * height - gaussians), mode="edge")
        codes = quantiser.quantise(values).reshape(height, width)
        stack = stacks[attribute.grid]
        codec, data = encode_plane(codes, quantiser.bits, codecs, stack.earlier)
        stack.append(codes)
        entry = PlaneEntry(attribute, part, codec, quantiser, width, height, len(data))
        table.append(entry.to_bytes())
        planes.append(data)
    head = GopHead(
        first_frame=first_frame,
        frames=len(pts),
        gaussians=gaussians,
        start_pts=int(pts[0]),
        last_pts=int(pts[-1]),
        last_duration=int(durations[-1]),
        grid=grid,
        planes=len(planes),
    )
    return b"".join([head.to_bytes(), pack_timing(pts, durations), *table, *planes])


def unpack_gop(payload: bytes, header: Header, limits: Limits) -> GopContent:
    """Decode the payload of a GOP chunk; needs nothing else of the file but its header.

    Raises:
        CorruptError: The payload breaks a rule of the spec.
        UnsupportedError: It uses a codec or attribute that this version does not know.
        LimitError: It is over `limits`.
    """
    head = parse_gop_head(payload)
    head.check_maxima(header)
    head.check_grid(header)
    pts, durations, entries, offset = _parse(payload, head, limits)
    limits.check_expansion(4 * sum(e.width * e.height for e in entries), len(payload))
    for entry in entries:
        limits.check(
            "plane_samples", entry.width * entry.height, "the number of samples of a plane"
        )
    values: dict[str, Float32Array] = {}
    stacks = _plane_stacks(head.gaussians, head.grid)
    for entry in entries:
        attribute = entry.attribute
        stack = stacks[attribute.grid]
        data = payload[offset : offset + entry.size]
        offset += entry.size
        try:
            codes = decode_plane(
                entry.codec,
                data,
                entry.width,
                entry.height,
                entry.quantiser.bits,
                limits,
                stack.earlier,
            )
        except CorruptError as error:
            raise CorruptError(f"plane {entry.name}: {error.message}") from error
        stack.append(codes)
        plane = entry.quantiser.dequantise(codes)
        if attribute.grid == "gaussians":
            plane = plane.reshape(-1)[: head.gaussians]
        if attribute.components == 1:
            values[attribute.name] = plane
            continue
        if entry.component == 0:
            values[attribute.name] = np.empty((*plane.shape, attribute.components), np.float32)
        values[attribute.name][..., entry.component] = plane
    return GopContent(_gop(values, head), head.first_frame, pts, durations)


def plane_table(payload: bytes, limits: Limits | None = None) -> tuple[PlaneEntry, ...]:
    """What is in the payload of a GOP chunk, plane by plane, without decoding any.

    Raises:
        CorruptError: The payload breaks a rule of the spec before its planes.
        UnsupportedError: It uses a codec or attribute that this version does not know.
    """
    head = parse_gop_head(payload)
    return _parse(payload, head, limits or Limits.from_environment())[2]


def dequantised(gop: Gop, precision: Precision) -> Gop:
    """What a decoder will get for `gop`, in the order given.

    Raises:
        ValueError: A value is not finite or out of the spec's bounds.
    """
    values: dict[str, Float32Array] = {}
    for attribute in ATTRIBUTES:
        original: Float32Array = getattr(gop, attribute.name)
        result = np.empty(original.shape, np.float32)
        if original.size:
            for part in range(attribute.components):
                component = _component(gop, attribute, part)
                quantiser = _quantiser(component, attribute, part, precision)
                restored = quantiser.dequantise(quantiser.quantise(component))
                target = result if attribute.components == 1 else result[..., part]
                target[...] = restored
        values[attribute.name] = result
    return Gop(**values)


def grid_size(gop: Gop) -> tuple[int, int, int]:
    """Gx, Gy and Gt of the tri-plane, all 0 if there is none."""
    gy, gx, _ = gop.xy.shape
    return gx, gy, gop.xt.shape[0]


def _parse(
    payload: bytes, head: GopHead, limits: Limits
) -> tuple[Ticks, Ticks, tuple[PlaneEntry, ...], int]:
    """Timing, plane table and the offset of the first plane; the planes end with the payload."""
    limits.check("gaussians", head.gaussians, "the number of Gaussians in a GOP")
    limits.check("gop_frames", head.frames, "the number of frames in a GOP")
    pts, durations, offset = unpack_timing(payload, GOP_HEAD_BYTES, head.start_pts, head.frames)
    if (int(pts[-1]), int(durations[-1])) != (head.last_pts, head.last_duration):
        raise CorruptError(
            f"last frame at {pts[-1]} for {durations[-1]} ticks, "
            f"the GOP's head says {head.last_pts} for {head.last_duration}"
        )
    entries, offset = parse_plane_table(payload, offset, head)
    end = offset + sum(entry.size for entry in entries)
    if end != len(payload):
        raise CorruptError(f"planes end at byte {end} of a GOP of {len(payload)} bytes")
    return pts, durations, entries, offset


def _plane_stacks(gaussians: int, grid: tuple[int, int, int]) -> dict[Grid, PlaneStack]:
    """An empty stack for the planes of each grid that the GOP has."""
    count = Counter(attribute.grid for attribute, *_ in expected_planes(gaussians, grid))
    stacks = {}
    for kind, planes in count.items():
        width, height = plane_size(kind, gaussians, grid)
        # Along a row of Gaussians x rises, from the left to the right of the picture.
        stacks[kind] = PlaneStack(planes, height, width, guided=kind == "gaussians")
    return stacks


def _component(gop: Gop, attribute: Attribute, part: int) -> NDArray[np.floating]:
    values: Float32Array = getattr(gop, attribute.name)
    if attribute.components > 1:
        values = values[..., part]
    # A Gaussian turned by half a circle is the same one; one period needs the fewest bits.
    return np.mod(values, np.pi) if attribute.name == "rotation" else values


def _quantiser(
    values: NDArray[np.floating], attribute: Attribute, part: int, precision: Precision
) -> Quantiser:
    quantiser = Quantiser.choose(values, attribute, part, precision)
    if quantiser.offset < attribute.low or quantiser.last > attribute.high:
        raise ValueError(
            f"{attribute.name} spans {quantiser.offset:g} to {quantiser.last:g}, "
            f"allowed is {attribute.low:g} to {attribute.high:g}"
        )
    return quantiser


def _gop(values: dict[str, Float32Array], head: GopHead) -> Gop:
    """The GOP of these values; attributes that had no plane are empty."""
    gx, gy, gt = head.grid
    sizes = {"gaussians": (head.gaussians,), "xy": (gy, gx), "xt": (gt, gx), "yt": (gt, gy)}
    for attribute in ATTRIBUTES:
        if attribute.name not in values:
            tail = (attribute.components,) if attribute.components > 1 else ()
            values[attribute.name] = np.empty((*sizes[attribute.grid], *tail), np.float32)
    return Gop(**{field.name: np.ascontiguousarray(values[field.name]) for field in fields(Gop)})
