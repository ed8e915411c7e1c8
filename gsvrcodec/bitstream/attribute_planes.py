"""Parameter planes of a GOP: quantisation and plane coding, both ways."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Collection, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.bitstream.plane_table import PlaneEntry
from gsvrcodec.bitstream.refinement_bits import (
    TABLE_BYTES,
    pack_parts,
    pack_table,
    parse_table,
    unpack_parts,
)
from gsvrcodec.errors import CorruptError
from gsvrcodec.limits import Limits
from gsvrcodec.model.attributes import GopShape, GridKind
from gsvrcodec.model.gop import Float32Array
from gsvrcodec.model.quantise import (
    Precision,
    Quantiser,
    bits_of,
    component,
    quantiser_of,
    refinements_of,
)
from gsvrcodec.model.refinement import REFINED
from gsvrcodec.planes import Codec, Memory, PlaneStack, decode_plane, encode_plane

#: What is remembered of the planes of a GOP, by attribute and component.
Memories = defaultdict[tuple[str, int], Memory]


def pack_planes(
    values: Mapping[str, NDArray[np.floating]],
    shape: GopShape,
    precision: Precision,
    codecs: Collection[Codec],
    memories: Memories | None = None,
) -> tuple[int, bytes]:
    """Quantise the values of attributes and code them as planes.

    Args:
        values: By attribute name; components in the last axis, Gaussians in stored order.
        shape: Counts of Gaussians and size of the tri-plane, which set the plane sizes.
        precision: Bits of each attribute, or quantiser steps of its components.
        codecs: Plane codecs to choose from.
        memories: Of similar planes that were packed before, for a quick choice; None = the best.

    Returns:
        Number of planes, and the bytes of plane table and planes.

    Raises:
        ValueError: A value is not finite or out of the spec's bounds.
    """
    table: list[bytes] = []
    planes: list[bytes] = []
    stacks = _plane_stacks(shape)
    quantised: dict[str, list[tuple[NDArray[np.floating], NDArray[np.uint16], Quantiser]]] = (
        defaultdict(list)
    )
    for attribute, part, width, height in shape.planes():
        samples = component(values[attribute.name], attribute, part)
        quantiser = quantiser_of(samples, attribute, part, precision)
        quantised[attribute.name].append((samples, quantiser.quantise(samples), quantiser))
        # Pad the last row with the last sample; decoders drop the padding.
        samples = np.pad(samples.reshape(-1), (0, width * height - samples.size), mode="edge")
        codes = quantiser.quantise(samples).reshape(height, width)
        stack = stacks[attribute.grid]
        memory = None if memories is None else memories[attribute.name, part]
        codec, data = encode_plane(codes, quantiser.bits, codecs, stack.prior, memory)
        stack.append(codes)
        entry = PlaneEntry(attribute, part, codec, quantiser, width, height, len(data))
        table.append(entry.to_bytes())
        planes.append(data)
    return len(planes), b"".join([*table, *planes, *_refinement(quantised, shape, precision)])


def _refinement(
    quantised: Mapping[str, Sequence[tuple[NDArray[np.floating], NDArray[np.uint16], Quantiser]]],
    shape: GopShape,
    precision: Precision,
) -> tuple[bytes, bytes]:
    """Table and bits of the refinement of new Gaussians."""
    refined = refinements_of(precision)
    if not refined or not shape.gaussians:
        return pack_table({}), b""
    base = {
        name: np.stack([own.dequantise(codes) for _, codes, own in quantised[name]], axis=-1)
        for name in (*REFINED, "indicator")
    }
    bits = bits_of(base | {"indicator": base["indicator"][:, 0]}, refined)
    single = [
        pack_parts(own.refine(samples, codes, bits[name]), bits[name])
        for name in refined
        for samples, codes, own in quantised[name]
    ]
    return pack_table(refined), np.packbits(np.concatenate(single)).tobytes()


def unpack_planes(
    entries: Sequence[PlaneEntry],
    payload: bytes,
    offset: int,
    shape: GopShape,
    limits: Limits,
) -> dict[str, Float32Array]:
    """Decode and dequantise the planes of a payload, from byte `offset` to its end.

    Returns:
        Values by attribute name: shape (N,) for Gaussians, (rows, columns) for a grid, with the
        components in a last axis if an attribute has more than one.

    Raises:
        CorruptError: A plane breaks a rule of the spec.
        LimitError: A plane, or all planes together, are over `limits`.
    """
    limits.check_expansion(4 * sum(e.width * e.height for e in entries), len(payload))
    for entry in entries:
        limits.check(
            "plane_samples", entry.width * entry.height, "the number of samples of a plane"
        )
    values: dict[str, Float32Array] = {}
    base: dict[str, list[tuple[NDArray[np.uint16], Quantiser]]] = defaultdict(list)
    stacks = _plane_stacks(shape)
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
                stack.prior,
            )
        except CorruptError as error:
            raise CorruptError(f"plane {entry.name}: {error.message}") from error
        stack.append(codes)
        plane = entry.quantiser.dequantise(codes)
        if attribute.grid not in ("xy", "xt", "yt"):
            plane = plane.reshape(-1)[: shape.samples(attribute.grid)]
            listed = codes.reshape(-1)[: shape.samples(attribute.grid)]
            base[attribute.name].append((listed, entry.quantiser))
        if attribute.components == 1:
            values[attribute.name] = plane
            continue
        if entry.component == 0:
            values[attribute.name] = np.empty((*plane.shape, attribute.components), np.float32)
        values[attribute.name][..., entry.component] = plane
    _refine(values, base, payload[offset:], shape)
    return values


def _refine(
    values: dict[str, Float32Array],
    base: Mapping[str, Sequence[tuple[NDArray[np.uint16], Quantiser]]],
    data: bytes,
    shape: GopShape,
) -> None:
    """Refine the values of new Gaussians, in place."""
    refined = parse_table(data[:TABLE_BYTES])
    bits = bits_of(values, refined) if refined and shape.gaussians else {}
    counts = {name: int(own.sum()) for name, own in bits.items()}
    total = sum(len(base[name]) * count for name, count in counts.items())
    if len(data) != TABLE_BYTES + -(-total // 8):
        raise CorruptError(f"refinement of {len(data)} bytes for {total} bits")
    single = np.unpackbits(np.frombuffer(data, np.uint8, offset=TABLE_BYTES))
    if single[total:].any():
        raise CorruptError("bits behind the refinement")
    at = 0
    for name, own in bits.items():
        for part, (codes, quantiser) in enumerate(base[name]):
            parts = unpack_parts(single[at : at + counts[name]], own)
            at += counts[name]
            plane = quantiser.refined(codes, parts, own)
            if values[name].ndim > 1:
                values[name][:, part] = plane
            else:
                values[name][:] = plane


def _plane_stacks(shape: GopShape) -> dict[GridKind, PlaneStack]:
    """An empty `PlaneStack` for each grid that has planes."""
    count = Counter(attribute.grid for attribute, *_ in shape.planes())
    stacks = {}
    for kind, planes in count.items():
        width, height = shape.plane_size(kind)
        # In a row of new Gaussians x rises, so position.x guides codec 4 to the neighbours above.
        stacks[kind] = PlaneStack(planes, height, width, guided=kind == "gaussians")
    return stacks
