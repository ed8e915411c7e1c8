"""Codec 1, deflate: samples, or left differences, as raw deflate (spec section "Codec 1")."""

from __future__ import annotations

import zlib

import numpy as np

from gsvrcodec.errors import CorruptError
from gsvrcodec.planes.samples import PlaneShape, Samples, StoredSamples, checked

_RAW_DEFLATE = -15
#: Predictor, the first byte of the data.
_PREDICT_NONE = 0
_PREDICT_LEFT = 1
#: Strategies to try: Huffman codes alone suit noise, matches suit smooth planes.
_STRATEGIES = (zlib.Z_FILTERED, zlib.Z_HUFFMAN_ONLY)


def encode(samples: Samples, shape: PlaneShape) -> bytes:
    """Code a plane with both predictors and all strategies; keep the smallest stream."""
    candidates = []
    for predictor, values in (
        (_PREDICT_NONE, samples),
        (_PREDICT_LEFT, _differences(samples, shape.bits)),
    ):
        planes = _split(values, shape)
        for strategy in _STRATEGIES:
            deflater = zlib.compressobj(9, zlib.DEFLATED, _RAW_DEFLATE, 9, strategy)
            body = deflater.compress(planes) + deflater.flush()
            candidates.append(bytes([predictor]) + body)
    return min(candidates, key=len)


def decode(data: bytes, shape: PlaneShape) -> Samples:
    """Decode a plane; CorruptError if `data` does not inflate to exactly this shape."""
    if not data or data[0] not in (_PREDICT_NONE, _PREDICT_LEFT):
        raise CorruptError(f"unknown predictor {data[0] if data else None} of a deflate plane")
    expected = shape.samples * shape.stored_bytes
    inflater = zlib.decompressobj(_RAW_DEFLATE)
    try:
        # The bound is one byte more than expected: a longer stream shows, and a right one can end.
        planes = inflater.decompress(data[1:], expected + 1)
    except zlib.error as error:
        raise CorruptError(f"damaged deflate stream ({error})") from error
    if len(planes) != expected or not inflater.eof or inflater.unused_data:
        raise CorruptError(f"deflate stream does not hold {expected} bytes and end there")
    values = checked(_join(planes, shape), shape)
    return values if data[0] == _PREDICT_NONE else _integrate(values, shape.bits)


def _differences(samples: Samples, bits: int) -> Samples:
    """Zigzag-coded differences modulo 2**bits to the left sample; in column 0 to the one above."""
    values = samples.astype(np.int32)
    change = values.copy()
    change[:, 1:] -= values[:, :-1]
    change[1:, 0] -= values[:-1, 0]
    half = 1 << (bits - 1)
    change = ((change + half) & ((1 << bits) - 1)) - half
    return ((change << 1) ^ (change >> 31)).astype(np.uint16)


def _integrate(values: Samples, bits: int) -> Samples:
    """The inverse of `_differences`."""
    # Sums wrap modulo 2**16, of which 2**bits is a part.
    one = np.uint16(1)
    total: Samples = (values >> one) ^ -(values & one)
    np.cumsum(total[:, 0], out=total[:, 0])
    np.cumsum(total, axis=1, out=total)
    total &= np.uint16((1 << bits) - 1)
    return total


def _split(values: Samples, shape: PlaneShape) -> bytes:
    """The low bytes of all samples, then, for more than 8 bits, the high bytes."""
    low = (values & 0xFF).astype(np.uint8).tobytes()
    if shape.stored_bytes == 1:
        return low
    return low + (values >> 8).astype(np.uint8).tobytes()


def _join(planes: bytes, shape: PlaneShape) -> StoredSamples:
    """The inverse of `_split`."""
    parts = np.frombuffer(planes, np.uint8).reshape(-1, shape.height, shape.width)
    values: StoredSamples = parts[0]
    if shape.stored_bytes == 2:
        values = values | parts[1].astype(np.uint16) << 8
    return values
