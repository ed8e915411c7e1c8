"""Lossless codecs of parameter planes: arrays of unsigned samples to bytes and back."""

from gsvrcodec.planes.context import Memory
from gsvrcodec.planes.prior import PlaneStack, PriorPlanes
from gsvrcodec.planes.table import (
    PACKS,
    Codec,
    CodedPlane,
    DamagedPlane,
    Stack,
    decode_plane,
    decode_planes,
    encode_plane,
)

__all__ = [
    "PACKS",
    "Codec",
    "CodedPlane",
    "DamagedPlane",
    "Memory",
    "PlaneStack",
    "PriorPlanes",
    "Stack",
    "decode_plane",
    "decode_planes",
    "encode_plane",
]
