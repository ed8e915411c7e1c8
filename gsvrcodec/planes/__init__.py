"""Plane codecs: an array of unsigned samples to bytes and back, without loss."""

from gsvrcodec.planes.prior import PlaneStack, PriorPlanes
from gsvrcodec.planes.table import PACKS, Codec, decode_plane, encode_plane

__all__ = ["PACKS", "Codec", "PlaneStack", "PriorPlanes", "decode_plane", "encode_plane"]
