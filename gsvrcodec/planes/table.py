"""The plane codecs by number, and the choice among them (spec section "Plane codecs")."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from enum import IntEnum

import numpy as np

from gsvrcodec.errors import CorruptError, UnsupportedError
from gsvrcodec.limits import Limits
from gsvrcodec.planes import constant, deflate, jxl, png
from gsvrcodec.planes.samples import MAX_BITS, Samples, Shape


class Codec(IntEnum):
    """Registered plane codecs."""

    CONSTANT = 0
    DEFLATE = 1
    PNG = 2
    JXL = 3


#: Codecs to choose from, by the name of a packing; a constant plane is always allowed.
PACKS: Mapping[str, frozenset[Codec]] = {
    "auto": frozenset({Codec.CONSTANT, Codec.DEFLATE, Codec.PNG, Codec.JXL}),
    "jxl": frozenset({Codec.CONSTANT, Codec.JXL}),
    "png": frozenset({Codec.CONSTANT, Codec.PNG}),
    "deflate": frozenset({Codec.CONSTANT, Codec.DEFLATE}),
}

_ENCODERS: Mapping[Codec, Callable[[Samples, Shape], bytes | None]] = {
    Codec.CONSTANT: constant.encode,
    Codec.DEFLATE: deflate.encode,
    Codec.PNG: png.encode,
    Codec.JXL: jxl.encode,
}
_DECODERS: Mapping[Codec, Callable[[bytes, Shape], Samples]] = {
    Codec.CONSTANT: constant.decode,
    Codec.DEFLATE: deflate.decode,
    Codec.PNG: png.decode,
    Codec.JXL: jxl.decode,
}


def encode_plane(
    samples: Samples, bits: int, codecs: Collection[Codec] = PACKS["auto"]
) -> tuple[Codec, bytes]:
    """Code a plane with each of `codecs` and keep the smallest result.

    Args:
        samples: Shape (height, width), each less than 2**bits.
        bits: 1 to 16.
        codecs: What to try; of results of one size the first by number wins. Deflate is used if
            none of them can code the plane, as happens to JPEG XL over 2048 samples in a row.

    Raises:
        ValueError: The samples do not fit.
    """
    if samples.ndim != 2 or samples.size == 0 or samples.dtype != np.uint16:
        raise ValueError(
            f"a plane is a uint16 array of two axes, not {samples.dtype}{samples.shape}"
        )
    if not 1 <= bits <= MAX_BITS or int(samples.max()) >= 1 << bits:
        raise ValueError(f"sample {int(samples.max())} in a plane of {bits} bits")
    shape = Shape(samples.shape[1], samples.shape[0], bits)
    best: tuple[Codec, bytes] | None = None
    for codec in sorted(codecs):
        data = _ENCODERS[codec](samples, shape)
        if data is not None and (best is None or len(data) < len(best[1])):
            best = codec, data
            if codec is Codec.CONSTANT:
                break
    return best or (Codec.DEFLATE, deflate.encode(samples, shape))


def decode_plane(
    codec: int, data: bytes, width: int, height: int, bits: int, limits: Limits
) -> Samples:
    """Decode a plane of known size; `data` must be used up exactly.

    Returns:
        Shape (height, width), each sample less than 2**bits.

    Raises:
        UnsupportedError: The codec is not registered.
        LimitError: The plane is over `limits`; nothing was allocated.
        CorruptError: The data is not a plane of this shape.
    """
    try:
        decoder = _DECODERS[Codec(codec)]
    except ValueError:
        raise UnsupportedError(f"unknown plane codec {codec}") from None
    if width < 1 or height < 1 or not 1 <= bits <= MAX_BITS:
        raise CorruptError(f"plane of {width}x{height} samples of {bits} bits")
    limits.check("plane_samples", width * height, "the number of samples of a plane")
    return decoder(data, Shape(width, height, bits))
