"""Scenes: Gaussians that stand still and belong to several GOPs (spec section "Scene chunk")."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.container.scene_head import SCENE_HEAD_BYTES, SceneHead, parse_scene_head
from gsvrcodec.errors import CorruptError
from gsvrcodec.limits import Limits
from gsvrcodec.model.attributes import ATTRIBUTES, STILL_ATTRIBUTES, Shape
from gsvrcodec.model.gop import TRIPLANE_CHANNELS, Float32Array, Gop
from gsvrcodec.model.order import strip_order
from gsvrcodec.model.plane_table import PlaneEntry, parse_plane_table
from gsvrcodec.model.planes import pack_planes, unpack_planes
from gsvrcodec.model.quantise import Precision
from gsvrcodec.planes import PACKS, Codec

_GRID = (0, 0, 0)
_OF_GAUSSIANS = tuple(a.name for a in ATTRIBUTES if a.grid == "gaussians")


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """What GOPs may share."""

    number: int  #: by which GOPs name it, from 1
    gop: Gop  #: its Gaussians as a GOP that stands still, in stored order; no tri-plane


def pack_scene(
    number: int, gop: Gop, precision: Precision, codecs: Collection[Codec] = PACKS["auto"]
) -> bytes:
    """Quantise, sort and code a scene into the payload of its chunk.

    Args:
        number: By which GOPs name it, from 1.
        gop: Its Gaussians, at least one; their motion is not looked at.
        precision: Bits of each attribute, or steps of its components.
        codecs: Plane codecs to choose from.

    Raises:
        ValueError: A value is not finite or out of the spec's bounds.
    """
    order = strip_order(gop.position)
    values = {a.name: getattr(gop, a.name)[order] for a in STILL_ATTRIBUTES}
    shape = Shape(len(gop), _GRID)
    planes, data = pack_planes(values, shape, precision, codecs, STILL_ATTRIBUTES)
    return SceneHead(number, len(gop), planes).to_bytes() + data


def unpack_scene(payload: bytes, limits: Limits) -> Scene:
    """Decode the payload of a scene chunk.

    Raises:
        CorruptError: The payload breaks a rule of the spec.
        UnsupportedError: It uses a codec or attribute that this version does not know.
        LimitError: It is over `limits`.
    """
    head, entries, offset = _parse(payload, limits)
    shape = Shape(head.gaussians, _GRID)
    values = unpack_planes(entries, payload, offset, shape, limits, STILL_ATTRIBUTES)
    return Scene(head.number, still_gop(**values))


def scene_table(payload: bytes, limits: Limits) -> tuple[PlaneEntry, ...]:
    """What is in the payload of a scene chunk, plane by plane. Raises as `unpack_scene`."""
    return _parse(payload, limits)[1]


def still_gop(
    position: Float32Array,
    log_scale: Float32Array,
    rotation: Float32Array,
    colour: Float32Array,
) -> Gop:
    """Return Gaussians at rest, without a tri-plane."""
    count = len(position)
    none = np.zeros((0, 0, TRIPLANE_CHANNELS), np.float32)
    return Gop(
        position=np.ascontiguousarray(position),
        log_scale=np.ascontiguousarray(log_scale),
        rotation=np.ascontiguousarray(rotation),
        colour=np.ascontiguousarray(colour),
        alpha=np.ones(count, np.float32),
        linear=np.zeros((count, 2), np.float32),
        quadratic=np.zeros((count, 2), np.float32),
        xy=none,
        xt=none,
        yt=none,
    )


def only(gop: Gop, shown: NDArray[np.bool_]) -> Gop:
    """Return some of the Gaussians of a GOP."""
    return replace(gop, **{name: getattr(gop, name)[shown] for name in _OF_GAUSSIANS})


def together(gop: Gop, still: Gop) -> Gop:
    """Return a GOP with Gaussians at rest added behind its own."""
    both = {
        name: np.concatenate([getattr(gop, name), getattr(still, name)]) for name in _OF_GAUSSIANS
    }
    return replace(gop, **both)


def with_scene(gop: Gop, scene: Scene, shown: NDArray[np.bool_]) -> Gop:
    """Return a GOP with what it shows of its scene.

    Raises:
        CorruptError: `shown` is not made for this scene.
    """
    if len(shown) != len(scene.gop):
        raise CorruptError(
            f"scene {scene.number} has {len(scene.gop)} Gaussians, the GOP expects {len(shown)}"
        )
    return together(gop, only(scene.gop, shown))


def _parse(payload: bytes, limits: Limits) -> tuple[SceneHead, tuple[PlaneEntry, ...], int]:
    """Head, plane table and the offset of the first plane."""
    head = parse_scene_head(payload)
    limits.check("gaussians", head.gaussians, "the number of Gaussians in a scene")
    expected = Shape(head.gaussians, _GRID).planes(STILL_ATTRIBUTES)
    entries, offset = parse_plane_table(payload, SCENE_HEAD_BYTES, head.planes, expected)
    return head, entries, offset
