"""Codec 3, JPEG XL: a bare, lossless, grey codestream of 8 or 16 bits (spec section "Codec 3")."""

from __future__ import annotations

import struct

import imagecodecs

from gsvrcodec.errors import CorruptError
from gsvrcodec.planes.jxl_header import check_codestream
from gsvrcodec.planes.samples import PlaneShape, Samples, checked

#: Efforts to try: 3 is best for noise, 5 for other planes; more is slower and seldom smaller.
_EFFORTS = (3, 5)
_CONTAINER_START = b"\x00\x00\x00\x0cJXL "
_BOX = struct.Struct(">I4s")


def encode(samples: Samples, shape: PlaneShape) -> bytes | None:
    """Code a plane with all efforts, keep the smallest; None = no codestream meets the spec."""
    stored = samples.astype(shape.dtype)
    candidates = []
    for effort in _EFFORTS:
        data = imagecodecs.jpegxl_encode(
            stored, lossless=True, effort=effort, numthreads=1, usecontainer=False
        )
        codestream = _codestream(bytes(data))
        try:
            check_codestream(codestream, shape)
        except CorruptError:
            continue
        candidates.append(codestream)
    return min(candidates, key=len, default=None)


def decode(data: bytes, shape: PlaneShape) -> Samples:
    """Decode a plane; CorruptError if `data` is not exactly one codestream of this shape."""
    check_codestream(data, shape)
    out = shape.empty()
    try:
        imagecodecs.jpegxl_decode(data, numthreads=1, out=out)
    except (RuntimeError, ValueError) as error:
        raise CorruptError(f"damaged JPEG XL codestream ({error})") from error
    return checked(out, shape)


def _codestream(data: bytes) -> bytes:
    """The bare codestream in `data`; libjxl puts it in boxes above 12 bits, whatever is asked."""
    if not data.startswith(_CONTAINER_START):
        return data
    offset = 0
    while offset + _BOX.size <= len(data):
        size, kind = _BOX.unpack_from(data, offset)
        end = offset + size if size else len(data)
        if kind == b"jxlc":
            return data[offset + _BOX.size : end]
        offset = max(end, offset + _BOX.size)
    return b""
