"""Plane codecs: an array of unsigned samples to bytes and back, without loss."""

from gsvrcodec.planes.prior import Earlier, PlaneStack
from gsvrcodec.planes.table import PACKS, Codec, decode_plane, encode_plane

__all__ = ["PACKS", "Codec", "Earlier", "PlaneStack", "decode_plane", "encode_plane"]
