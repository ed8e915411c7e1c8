"""Payload of a GOP chunk: head, timing, plate, plane table, planes (spec section "GOP chunk")."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.bitstream.attribute_planes import Memories, pack_planes, unpack_planes
from gsvrcodec.bitstream.gop_head import GopHead, GopSummary, parse_gop_head
from gsvrcodec.bitstream.header import Header
from gsvrcodec.bitstream.plane_entries import IMAGE_CODECS
from gsvrcodec.bitstream.plane_table import PlaneEntry, parse_plane_table
from gsvrcodec.bitstream.plate import find_plate, plate_bytes
from gsvrcodec.bitstream.timing import pack_timing, unpack_timing
from gsvrcodec.errors import CorruptError, spec_section
from gsvrcodec.limits import Limits
from gsvrcodec.model.attributes import ATTRIBUTES, CARRIED_ATTRIBUTES, MODE, GopShape
from gsvrcodec.model.gop import Float32Array, Gop, grid_size
from gsvrcodec.model.order import strip_order
from gsvrcodec.model.plate import Plate
from gsvrcodec.model.prediction import CHANGED, DROPPED, MOVED, Carried, Modes, carry_over
from gsvrcodec.model.quantise import MODE_QUANTISER, Precision
from gsvrcodec.model.reconstruction import Blending
from gsvrcodec.model.time import Ticks
from gsvrcodec.planes import PACKS, Codec, avif, encode_plane

#: Field of `Carried` that each attribute of carried Gaussians is stored from.
_FIELDS = {a: a.change_of or a.name for a in CARRIED_ATTRIBUTES}


@dataclass(frozen=True, slots=True, eq=False)
class GopContent:
    """Decoded content of a GOP chunk."""

    new: Gop  #: new Gaussians and the deformation field; all Gaussians of a key GOP
    first_frame: int  #: number of the GOP's first frame in the file
    pts: Ticks  #: (F,) presentation timestamps, ticks, strictly increasing
    durations: Ticks  #: (F,) durations, ticks, 0 = not known
    reference: int = 0  #: frames from the reference's first frame to this GOP's; 0 = key GOP
    carried: Carried | None = None  #: how the reference's Gaussians go on; None = key GOP
    plate: bytes | None = None  #: coded; None = the GOP stores none

    def gop(self, reference: Gop | None, frames: int, blending: Blending = "mean") -> Gop:
        """Return the whole GOP.

        Args:
            reference: The GOP that this one refers to; None for a key GOP.
            frames: Frames of the reference.
            blending: How pictures are formed.

        Raises:
            CorruptError: The reference has another number of Gaussians than the GOP expects.
            ValueError: The GOP is predicted, and no reference is given.
        """
        if self.carried is None:
            return self.new
        if reference is None:
            raise ValueError(f"the GOP at frame {self.first_frame} needs its reference")
        if len(reference) != len(self.carried.mode):
            raise CorruptError(
                f"the reference has {len(reference)} Gaussians, "
                f"the GOP expects {len(self.carried.mode)}",
                section="5.5",
            )
        lengths = frames, len(self.pts)
        return carry_over(reference, lengths, self.carried, self.new, blending)


def pack_gop(
    gop: Gop,
    pts: Ticks,
    durations: Ticks,
    first_frame: int,
    precision: Precision,
    codecs: Collection[Codec] = PACKS["auto"],
    *,
    reference: int = 0,
    carried: Carried | None = None,
    memories: Memories | None = None,
    blending: Blending = "mean",
    plate: bytes | None = None,
) -> bytes:
    """Quantise, sort and code a GOP into the payload of its chunk.

    Args:
        gop: The GOP to store; of a predicted one the new Gaussians alone. All values are finite.
        pts: Shape (F,), strictly increasing, ticks.
        durations: Shape (F,), ticks, 0 = not known.
        first_frame: Number of the GOP's first frame in the file.
        precision: Bits (1 to 16) of each attribute, or quantiser steps of its components.
        codecs: Plane codecs to choose from.
        reference: Frames from the first frame of the reference to that of the GOP; 0 = key GOP.
        carried: How the Gaussians of the reference go on; None = key GOP.
        memories: Of planes of the same GOP at other steps, for a quick choice; None = the best.
        blending: How pictures are formed; sums have no opacities.
        plate: Coded picture of the coded size; None = the GOP stores none.

    Raises:
        ValueError: A value is not finite or out of the spec's bounds, or timing is inconsistent;
            a key GOP has carried Gaussians, or a predicted one none or a plate; modes and values
            disagree.
    """
    if bool(reference) != (carried is not None):
        raise ValueError("a predicted GOP has a reference and carried Gaussians, a key GOP neither")
    if plate is not None and (reference or blending == "sum"):
        raise ValueError("a plate in a predicted GOP or a sum")
    if not 1 <= len(pts) == len(durations):
        raise ValueError(f"{len(pts)} timestamps and {len(durations)} durations")
    order = strip_order(gop.position)
    values: dict[str, NDArray[np.floating]] = {}
    for attribute in ATTRIBUTES:
        samples: Float32Array = getattr(gop, attribute.name)
        values[attribute.name] = samples[order] if attribute.grid == "gaussians" else samples
    dropped = changed = moved = 0
    if carried is not None:
        values |= {a.name: getattr(carried, field) for a, field in _FIELDS.items()}
        values[MODE.name] = carried.mode.astype(np.float32)
        dropped, changed, moved = _counts(carried.mode)
        if (changed, moved) != (len(carried.position), len(carried.indicator)):
            raise ValueError(
                f"modes of {changed} changed and {moved} moved Gaussians with "
                f"{len(carried.position)} changes and {len(carried.indicator)} motions"
            )
    from_reference = 0 if carried is None else len(carried.mode)
    shape = GopShape(len(gop), grid_size(gop), from_reference, changed, moved, blending)
    planes, data = pack_planes(values, shape, precision, codecs, memories)
    head = GopHead(
        first_frame=first_frame,
        frames=len(pts),
        gaussians=from_reference - dropped + len(gop),
        start_pts=int(pts[0]),
        last_pts=int(pts[-1]),
        last_duration=int(durations[-1]),
        reference=reference,
        grid=shape.grid,
        planes=planes,
        carried_from=from_reference,
        dropped=dropped,
        changed=changed,
        moved=moved,
        plate=plate is not None,
    )
    return b"".join([head.to_bytes(), pack_timing(pts, durations), plate_bytes(plate), data])


def unpack_gop(payload: bytes, header: Header | None, limits: Limits) -> GopContent:
    """Decode the payload of a GOP chunk.

    Args:
        payload: Of the GOP chunk.
        header: Of the file; no maximum of the header may be exceeded. None = the GOP, of weighted
            means, is in no file yet.
        limits: Limits on the content.

    Raises:
        CorruptError: The payload breaks a rule of the spec, or exceeds a maximum of the header.
        UnsupportedError: The payload uses a codec or attribute that this version does not know.
        LimitError: The GOP is over `limits`.
    """
    head, pts, durations, plate, entries, offset = _parse(payload, header, limits)
    shape = head.shape(header.blending if header else "mean")
    values = unpack_planes(entries, payload, offset, shape, limits)
    carried = None if head.is_key else _carried(values, head)
    return GopContent(
        _gop(values, shape), head.first_frame, pts, durations, head.reference, carried, plate
    )


@spec_section("5.7")
def unpack_plate(data: bytes, size: tuple[int, int] | None = None) -> Plate:
    """Decode a plate.

    Args:
        data: As coded.
        size: Width and height of the coded frame, pixels; None = whatever the picture has.

    Raises:
        CorruptError: It is not a picture of this size as plates have to be.
    """
    return Plate(avif.decode(data, size))


def coded_plate(payload: bytes) -> bytes | None:
    """Return the coded plate of a sound payload of a GOP chunk; None = the GOP stores none."""
    return _parse(payload, None, Limits())[3] if parse_gop_head(payload).plate else None


def on_plate_of(payload: bytes, reference: GopSummary) -> bytes:
    """Return a key GOP with a plate as one that has the plate of an earlier GOP.

    It is predicted from that GOP, and drops all its Gaussians; else it stays as it is.

    Args:
        payload: Of the chunk of the key GOP; a sound one.
        reference: The GOP that stores the same plate.
    """
    head, pts, durations, _, entries, offset = _parse(payload, None, Limits())
    end = offset + sum(entry.size for entry in entries)
    count = reference.gaussians
    head = replace(
        head,
        reference=head.first_frame - reference.first_frame,
        carried_from=count,
        dropped=count,
        plate=False,
    )
    table, planes = list(entries), [payload[offset:end]]
    for attribute, part, width, height in head.shape("mean").planes()[len(entries) :]:
        modes = np.full((height, width), DROPPED, np.uint16)
        codec, coded = encode_plane(modes, MODE_QUANTISER.bits, {Codec.CONSTANT})
        table.append(PlaneEntry(attribute, part, codec, MODE_QUANTISER, width, height, len(coded)))
        planes.append(coded)
    return b"".join(
        [
            replace(head, planes=len(table)).to_bytes(),
            pack_timing(pts, durations),
            *(entry.to_bytes() for entry in table),
            *planes,
            payload[end:],
        ]
    )


def plane_table(
    payload: bytes, header: Header, limits: Limits
) -> tuple[tuple[PlaneEntry, ...], int, int]:
    """The plane table of a GOP chunk's payload, the offset of the first plane, bytes of the plate.

    Nothing is decoded. Raises as `unpack_gop`.
    """
    *_, plate, entries, offset = _parse(payload, header, limits)
    return entries, offset, len(plate or b"")


def _parse(
    payload: bytes, header: Header | None, limits: Limits
) -> tuple[GopHead, Ticks, Ticks, bytes | None, tuple[PlaneEntry, ...], int]:
    """Head, timestamps, durations, coded plate, plane table, and the offset of the first plane."""
    head = parse_gop_head(payload)
    if header is not None:
        head.check_maxima(header)
    limits.check("gaussians", head.gaussians, "the number of Gaussians in a GOP")
    limits.check("gaussians", head.carried_from, "the number of Gaussians in a reference")
    limits.check("gop_frames", head.frames, "the number of frames in a GOP")
    pts, durations, offset = unpack_timing(payload, head.length, head.start_pts, head.frames)
    if (int(pts[-1]), int(durations[-1])) != (head.last_pts, head.last_duration):
        raise CorruptError(
            f"last frame at {pts[-1]} for {durations[-1]} ticks, "
            f"the GOP's head says {head.last_pts} for {head.last_duration}",
            section="5.2",
        )
    plate = None
    if head.plate:
        plate, offset = find_plate(payload, offset)
    planes = head.shape(header.blending if header else "mean").planes()
    entries, offset = parse_plane_table(payload, offset, head.planes, planes)
    has_images = any(entry.codec in IMAGE_CODECS for entry in entries)
    if header is not None and has_images and not header.image_codecs:
        raise CorruptError("PNG or JPEG XL in a file whose header has not their flag", section="4")
    return head, pts, durations, plate, entries, offset


@spec_section("5.5")
def _carried(values: dict[str, Float32Array], head: GopHead) -> Carried:
    """How the Gaussians of the reference go on; checks that modes and counts agree."""
    # Sums have no planes of opacities, and so no values of them.
    values.setdefault("log_opacity_change", np.zeros(head.changed, np.float32))
    found = {field: values.get(a.name, _no_values(a.components)) for a, field in _FIELDS.items()}
    mode = found.pop(MODE.name).astype(np.uint8)
    if mode.size and mode.max() > DROPPED:
        raise CorruptError(f"mode {mode.max()} of a Gaussian, expected at most {DROPPED}")
    dropped, changed, moved = _counts(mode)
    if (dropped, changed, moved) != (head.dropped, head.changed, head.moved):
        raise CorruptError(
            f"{dropped} Gaussians are dropped, {changed} changed and {moved} moved, "
            f"the GOP's head says {head.dropped}, {head.changed} and {head.moved}"
        )
    return Carried(mode=mode, **found)


def _counts(mode: Modes) -> tuple[int, int, int]:
    """Numbers of Gaussians that are dropped, changed and moved."""
    return (
        int(np.count_nonzero(mode == DROPPED)),
        int(np.count_nonzero(mode & CHANGED)),
        int(np.count_nonzero(mode & MOVED)),
    )


def _gop(values: dict[str, Float32Array], shape: GopShape) -> Gop:
    """The GOP of decoded values; attributes without a plane become empty, opacities of sums 1."""
    gx, gy, gt = shape.grid
    sizes = {"gaussians": (shape.gaussians,), "xy": (gy, gx), "xt": (gt, gx), "yt": (gt, gy)}
    for attribute in ATTRIBUTES:
        tail = (attribute.components,) if attribute.components > 1 else ()
        size = (*sizes[attribute.grid], *tail)
        found = values.get(attribute.name)
        if found is None:
            values[attribute.name] = np.zeros(size, np.float32)
        elif found.shape != size:  # channels that the tri-plane of a mean lacks
            values[attribute.name] = np.zeros(size, np.float32)
            values[attribute.name][..., : found.shape[-1]] = found
    return Gop(**{field.name: np.ascontiguousarray(values[field.name]) for field in fields(Gop)})


def _no_values(components: int) -> Float32Array:
    return np.empty((0, components) if components > 1 else 0, np.float32)
