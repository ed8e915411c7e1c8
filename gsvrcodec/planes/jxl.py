"""Codec 3, JPEG XL: a bare, lossless, grey codestream of 8 or 16 bits (spec section "Codec 3")."""

from __future__ import annotations

import struct

import imagecodecs

from gsvrcodec.errors import CorruptError
from gsvrcodec.planes.jxl_header import check_codestream
from gsvrcodec.planes.samples import PlaneShape, Samples, checked

#: Noise does best with 3, all else with 5; more effort takes longer and mostly makes planes larger.
_EFFORTS = (3, 5)
_CONTAINER_START = b"\x00\x00\x00\x0cJXL "
_BOX = struct.Struct(">I4s")


def encode(samples: Samples, shape: PlaneShape) -> bytes | None:
    """The smallest codestream of some efforts, None if the library makes none that we allow."""
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
    """The samples of a codestream of exactly this size and depth, which ends with `data`."""
    check_codestream(data, shape)
    out = shape.empty()
    try:
        imagecodecs.jpegxl_decode(data, numthreads=1, out=out)
    except (RuntimeError, ValueError) as error:
        raise CorruptError(f"damaged JPEG XL codestream ({error})") from error
    return checked(out, shape)


def _codestream(data: bytes) -> bytes:
    """The codestream in `data`; over 12 bits the library wraps it in boxes whatever it is told."""
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
