"""Codec 2, PNG: a grey image of 8 or 16 bits (spec section "Codec 2").

Structure, size and compressed data are checked before the image library is called: the library
accepts trailing bytes and a missing end, and converts pictures that are not grey.
"""

from __future__ import annotations

import struct
import zlib

import imagecodecs

from gsvrcodec.errors import CorruptError
from gsvrcodec.planes.samples import PlaneShape, Samples, checked

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_HEAD = struct.Struct(">I4s")
_IHDR = struct.Struct(">IIBBBBB")
_CRC = struct.Struct(">I")
_LEVEL = 9


def encode(samples: Samples, shape: PlaneShape) -> bytes:
    """Code a plane as a grey PNG."""
    return bytes(imagecodecs.png_encode(samples.astype(shape.dtype), level=_LEVEL))


def decode(data: bytes, shape: PlaneShape) -> Samples:
    """Decode a plane; CorruptError if `data` is not exactly one grey PNG of this shape."""
    _check_image_data(_image_data(data, shape), shape)
    out = shape.empty()
    try:
        imagecodecs.png_decode(data, out=out)
    except (RuntimeError, ValueError) as error:
        raise CorruptError(f"damaged PNG ({error})") from error
    return checked(out, shape)


def _image_data(data: bytes, shape: PlaneShape) -> bytes:
    """Check signature and chunks; return the joined payloads of the IDAT chunks."""
    if not data.startswith(_SIGNATURE):
        raise CorruptError("not a PNG")
    parts: list[bytes] = []
    offset = len(_SIGNATURE)
    first = True
    while True:
        if len(data) - offset < _HEAD.size + _CRC.size:
            raise CorruptError("PNG without its end")
        size, kind = _HEAD.unpack_from(data, offset)
        end = offset + _HEAD.size + size
        if end + _CRC.size > len(data):
            raise CorruptError("PNG chunk past the end of the plane")
        (crc,) = _CRC.unpack_from(data, end)
        if zlib.crc32(data[offset + 4 : end]) != crc:
            raise CorruptError("PNG chunk with a CRC mismatch")
        payload = data[offset + _HEAD.size : end]
        offset = end + _CRC.size
        if first != (kind == b"IHDR"):
            raise CorruptError("PNG whose first chunk is not its only IHDR")
        if first:
            _check_ihdr(payload, shape)
            first = False
        elif kind == b"IDAT":
            parts.append(payload)
        elif kind == b"IEND" and not payload:
            break
        else:
            raise CorruptError(f"PNG chunk {kind!r} is not allowed in a plane")
    if offset != len(data):
        raise CorruptError(f"{len(data) - offset} bytes after the end of a PNG")
    return b"".join(parts)


def _check_ihdr(payload: bytes, shape: PlaneShape) -> None:
    if len(payload) != _IHDR.size:
        raise CorruptError(f"PNG header of {len(payload)} bytes")
    found = _IHDR.unpack(payload)
    # Width, height, bit depth; grey, deflate, filter method 0, not interlaced.
    expected = (shape.width, shape.height, 8 * shape.stored_bytes, 0, 0, 0, 0)
    if found != expected:
        raise CorruptError(f"PNG header {found}, expected {expected}")


def _check_image_data(compressed: bytes, shape: PlaneShape) -> None:
    """Check that the data inflates to exactly the rows of the plane, with known row filters."""
    row = 1 + shape.width * shape.stored_bytes
    expected = row * shape.height
    inflater = zlib.decompressobj()
    try:
        rows = inflater.decompress(compressed, expected + 1)
    except zlib.error as error:
        raise CorruptError(f"damaged PNG data ({error})") from error
    if len(rows) != expected or not inflater.eof or inflater.unused_data:
        raise CorruptError(f"PNG data does not hold {expected} bytes and end there")
    if max(rows[::row]) > 4:
        raise CorruptError(f"PNG filter {max(rows[::row])}")
