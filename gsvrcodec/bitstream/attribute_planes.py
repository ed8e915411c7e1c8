"""Parameter planes of a GOP: quantisation and plane coding, both ways."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Collection, Mapping, Sequence
from itertools import groupby
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.bitstream.plane_table import PlaneEntry
from gsvrcodec.bitstream.refinement_bits import (
    TABLE_BYTES,
    pack_numbers,
    pack_table,
    parse_table,
    unpack_numbers,
)
from gsvrcodec.errors import CorruptError
from gsvrcodec.limits import Limits
from gsvrcodec.model.attributes import Attribute, GopShape, GridKind
from gsvrcodec.model.gop import Float32Array
from gsvrcodec.model.quantise import (
    SET_BITS,
    Coded,
    Finer,
    Precision,
    Quantiser,
    bits_of,
    quantised,
    refinements_of,
    values_of,
    values_of_coded,
)
from gsvrcodec.model.refinement import Refinements
from gsvrcodec.planes import (
    Codec,
    CodedPlane,
    DamagedPlane,
    Memory,
    PlaneStack,
    Stack,
    decode_planes,
    encode_plane,
)

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
    coded = quantised(values, shape.attributes(), precision)
    for attribute, part, width, height in shape.planes():
        quantiser, codes = coded[attribute.name][part].quantiser, coded[attribute.name][part].codes
        # Pad the last row with the last sample; decoders drop the padding.
        padding = width * height - codes.size
        plane = np.pad(codes.reshape(-1), (0, padding), mode="edge").reshape(height, width)
        stack = stacks[attribute.grid]
        memory = None if memories is None else memories[attribute.name, part]
        codec, data = encode_plane(plane, quantiser.bits, codecs, stack.prior, memory)
        stack.append(plane)
        entry = PlaneEntry(attribute, part, codec, quantiser, width, height, len(data))
        table.append(entry.to_bytes())
        planes.append(data)
    refinements = refinements_of(precision) if shape.gaussians else {}
    refinement = _pack_refinement(coded, refinements)
    return len(planes), b"".join([*table, *planes, refinement])


def _pack_refinement(coded: Mapping[str, Sequence[Coded]], refinements: Refinements) -> bytes:
    """Table and bits of the refinement of new Gaussians (spec section "Refinement")."""
    if not refinements:
        return pack_table(refinements)
    base = {name: values_of_coded(parts) for name, parts in coded.items()}
    each = [
        (part.parts(bits), bits)
        for name, bits in bits_of(base, refinements).items()
        for part in coded[name]
    ]
    numbers, bits = map(np.concatenate, zip(*each, strict=True))
    return pack_table(refinements) + pack_numbers(numbers, bits)


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
    most = max((entry.width * entry.height for entry in entries), default=0)
    limits.check("plane_samples", most, "the number of samples of a plane")
    stacks, planes, coded = _lay_out(entries, offset, shape)
    try:
        decode_planes(payload, planes, stacks)
    except DamagedPlane as damaged:
        error = damaged.error
        what = f"plane {entries[damaged.number].name}: {error.message}"
        raise CorruptError(what, section=error.section) from error
    rest = payload[offset + sum(entry.size for entry in entries) :]
    refinements = parse_table(rest[:TABLE_BYTES])
    if refinements and not shape.gaussians:
        raise CorruptError("a refinement without new Gaussians", section="5.6")
    replaced = refinements.keys() - SET_BITS
    values = {name: own.values() for name, own in coded.items() if name not in replaced}
    bits = bits_of(values, refinements)
    each = np.array([own for name, own in bits.items() for _ in coded[name].codes], np.int8)
    numbers = unpack_numbers(rest[TABLE_BYTES:], each.ravel()).reshape(each.shape)
    for name, own in bits.items():
        components = len(coded[name].codes)
        values[name] = coded[name].values(Finer(own, numbers[:components]))
        numbers = numbers[components:]
    return values


class _Coded(NamedTuple):
    """The codes of an attribute."""

    attribute: Attribute
    codes: NDArray[np.uint16]  #: (components, ...)
    quantisers: Sequence[Quantiser]  #: of each component

    def values(self, finer: Finer | None = None) -> Float32Array:
        """Values of the codes."""
        return values_of(self.codes, self.quantisers, self.attribute, finer)


def _lay_out(
    entries: Sequence[PlaneEntry], offset: int, shape: GopShape
) -> tuple[list[Stack], list[CodedPlane], dict[str, _Coded]]:
    """Say where each plane lies in a payload, from `offset` on, and where its samples go.

    Returns:
        A stack for each grid; the planes; and by attribute name what the stacks will hold, without
        the padding of the last row.
    """
    stacks: list[Stack] = []
    planes: list[CodedPlane] = []
    coded = {}
    for kind, attributes in groupby(shape.attributes(), lambda attribute: attribute.grid):
        own = list(attributes)
        width, height = shape.plane_size(kind)
        samples = np.empty((sum(a.components for a in own), height, width), np.uint16)
        codes = samples
        if kind not in ("xy", "xt", "yt"):
            codes = samples.reshape(len(samples), -1)[:, : shape.samples(kind)]
        place = 0
        for attribute in own:
            stored = entries[len(planes) : len(planes) + attribute.components]
            part = codes[place : place + len(stored)]
            coded[attribute.name] = _Coded(attribute, part, [entry.quantiser for entry in stored])
            for entry in stored:
                bits, where = entry.quantiser.bits, (offset, entry.size)
                planes.append(CodedPlane(entry.codec, bits, *where, len(stacks), place))
                offset += entry.size
                place += 1
        stacks.append(Stack(samples, _is_guided(kind)))
    return stacks, planes, coded


def _is_guided(kind: GridKind) -> bool:
    """Whether the first plane of a grid guides codec 4 to the neighbours above.

    In a row of new Gaussians x rises, and position.x is the first plane.
    """
    return kind == "gaussians"


def _plane_stacks(shape: GopShape) -> dict[GridKind, PlaneStack]:
    """An empty `PlaneStack` for each grid that has planes."""
    count = Counter(attribute.grid for attribute, *_ in shape.planes())
    stacks = {}
    for kind, planes in count.items():
        width, height = shape.plane_size(kind)
        stacks[kind] = PlaneStack(planes, height, width, guided=_is_guided(kind))
    return stacks
