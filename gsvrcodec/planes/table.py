"""The plane codecs by number, and the choice among them (spec section "Plane codecs")."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from enum import IntEnum

import numpy as np

from gsvrcodec.errors import CorruptError, UnsupportedError
from gsvrcodec.limits import Limits
from gsvrcodec.planes import constant, context, deflate, jxl, png, ranges
from gsvrcodec.planes.prior import PriorPlanes
from gsvrcodec.planes.samples import MAX_BITS, PlaneShape, Samples


class Codec(IntEnum):
    """Registered plane codecs."""

    CONSTANT = 0
    DEFLATE = 1
    PNG = 2
    JXL = 3
    CONTEXT = 4
    RANGES = 5


#: Codecs to choose from, by the name of a packing; a constant plane is always allowed.
PACKS: Mapping[str, frozenset[Codec]] = {
    "auto": frozenset(Codec),
    "entropy": frozenset({Codec.CONSTANT, Codec.CONTEXT, Codec.RANGES}),
    "jxl": frozenset({Codec.CONSTANT, Codec.JXL}),
    "png": frozenset({Codec.CONSTANT, Codec.PNG}),
    "deflate": frozenset({Codec.CONSTANT, Codec.DEFLATE}),
}

#: All but codec 4, which looks at other planes too.
_ENCODERS: Mapping[Codec, Callable[[Samples, PlaneShape], bytes | None]] = {
    Codec.CONSTANT: constant.encode,
    Codec.DEFLATE: deflate.encode,
    Codec.PNG: png.encode,
    Codec.JXL: jxl.encode,
    Codec.RANGES: ranges.encode,
}
_DECODERS: Mapping[Codec, Callable[[bytes, PlaneShape], Samples]] = {
    Codec.CONSTANT: constant.decode,
    Codec.DEFLATE: deflate.decode,
    Codec.PNG: png.decode,
    Codec.JXL: jxl.decode,
    Codec.RANGES: ranges.decode,
}
#: In which codecs are tried: those first that end the search or are mostly best.
_ORDER = (Codec.CONSTANT, Codec.RANGES, Codec.CONTEXT, Codec.DEFLATE, Codec.PNG, Codec.JXL)
#: Of a larger plane, codecs other than 4 and 5 get to try so many samples first, and the whole only
#: if they come as close as this to the smallest stream so far.
_SAMPLE = 8192
_PROMISING = 1.05


def encode_plane(
    samples: Samples,
    bits: int,
    codecs: Collection[Codec] = PACKS["auto"],
    prior: PriorPlanes | None = None,
) -> tuple[Codec, bytes]:
    """Code a plane with each of `codecs` and keep the smallest result.

    Args:
        samples: PlaneShape (height, width), each less than 2**bits.
        bits: 1 to 16.
        codecs: What to try; of results of one size the first of `_ORDER` wins. Deflate is used if
            none of them can code the plane, as happens to JPEG XL over 2048 samples in a row.
        prior: The planes of the same grid before this one, None = there are none.

    Raises:
        ValueError: The samples do not fit.
    """
    if samples.ndim != 2 or samples.size == 0 or samples.dtype != np.uint16:
        raise ValueError(
            f"a plane is a uint16 array of two axes, not {samples.dtype}{samples.shape}"
        )
    if not 1 <= bits <= MAX_BITS or int(samples.max()) >= 1 << bits:
        raise ValueError(f"sample {int(samples.max())} in a plane of {bits} bits")
    shape = PlaneShape(samples.shape[1], samples.shape[0], bits)
    best: tuple[Codec, bytes] | None = None
    for codec in sorted(codecs, key=_ORDER.index):
        if codec is Codec.CONTEXT:
            data: bytes | None = context.encode(
                samples, shape, prior or PriorPlanes.none(shape.height, shape.width)
            )
        elif best and not _promising(codec, samples, shape, len(best[1])):
            continue
        else:
            data = _ENCODERS[codec](samples, shape)
        if data is not None and (best is None or len(data) < len(best[1])):
            best = codec, data
            if codec is Codec.CONSTANT:
                break
    return best or (Codec.DEFLATE, deflate.encode(samples, shape))


def _promising(codec: Codec, samples: Samples, shape: PlaneShape, best: int) -> bool:
    """Whether a codec may come below `best` bytes, by what it makes of the first rows."""
    rows = max(1, _SAMPLE // shape.width)
    if codec is Codec.RANGES or 2 * rows >= shape.height:
        return True
    part = _ENCODERS[codec](samples[:rows], PlaneShape(shape.width, rows, shape.bits))
    return part is not None and len(part) * shape.height <= _PROMISING * best * rows


def decode_plane(
    codec: int,
    data: bytes,
    width: int,
    height: int,
    bits: int,
    limits: Limits,
    prior: PriorPlanes | None = None,
) -> Samples:
    """Decode a plane of known size; `data` must be used up exactly.

    Returns:
        PlaneShape (height, width), each sample less than 2**bits.

    Raises:
        UnsupportedError: The codec is not registered.
        LimitError: The plane is over `limits`; nothing was allocated.
        CorruptError: The data is not a plane of this shape.
    """
    try:
        known = Codec(codec)
    except ValueError:
        raise UnsupportedError(f"unknown plane codec {codec}") from None
    if width < 1 or height < 1 or not 1 <= bits <= MAX_BITS:
        raise CorruptError(f"plane of {width}x{height} samples of {bits} bits")
    limits.check("plane_samples", width * height, "the number of samples of a plane")
    shape = PlaneShape(width, height, bits)
    if known is Codec.CONTEXT:
        return context.decode(data, shape, prior or PriorPlanes.none(height, width))
    return _DECODERS[known](data, shape)
