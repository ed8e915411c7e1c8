"""Lossless codecs of parameter planes: arrays of unsigned samples to bytes and back."""

from gsvrcodec.planes.context import Memory
from gsvrcodec.planes.prior import PlaneStack, PriorPlanes
from gsvrcodec.planes.table import PACKS, Codec, decode_plane, encode_plane

__all__ = ["PACKS", "Codec", "Memory", "PlaneStack", "PriorPlanes", "decode_plane", "encode_plane"]
