"""Registry of plane codecs, and the choice of the smallest (spec section "Plane codecs")."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from enum import IntEnum

import numpy as np

from gsvrcodec.errors import CorruptError, UnsupportedError, spec_section
from gsvrcodec.limits import Limits
from gsvrcodec.planes import constant, context, deflate, jxl, png, ranges
from gsvrcodec.planes.prior import PriorPlanes
from gsvrcodec.planes.samples import MAX_BITS, PlaneShape, Samples


class Codec(IntEnum):
    """Numbers of the registered plane codecs."""

    CONSTANT = 0
    DEFLATE = 1
    PNG = 2
    JXL = 3
    CONTEXT = 4
    RANGES = 5


#: Codecs to choose from, by the name of option --pack; `CONSTANT` is always allowed.
#: "auto" has the format's own coders and deflate. In 259 planes of encodes of the samples bunny,
#: city and tree, deflate saves 0.38 % of the bytes, most of it on the grids over time; JPEG XL
#: would save another 0.01 % and PNG nothing, and a decoder would need their libraries.
PACKS: Mapping[str, frozenset[Codec]] = {
    "auto": frozenset({Codec.CONSTANT, Codec.DEFLATE, Codec.CONTEXT, Codec.RANGES}),
    "entropy": frozenset({Codec.CONSTANT, Codec.CONTEXT, Codec.RANGES}),
    "jxl": frozenset({Codec.CONSTANT, Codec.JXL}),
    "png": frozenset({Codec.CONSTANT, Codec.PNG}),
    "deflate": frozenset({Codec.CONSTANT, Codec.DEFLATE}),
}

#: All codecs but codec 4, which also needs the prior planes.
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
#: Order of trials: first the codecs that end the search or are usually the smallest.
_ORDER = (Codec.CONSTANT, Codec.RANGES, Codec.CONTEXT, Codec.DEFLATE, Codec.PNG, Codec.JXL)
#: In a large plane a codec other than 4 and 5 first codes this many samples.
_TRIAL_SAMPLES = 8192
#: The codec then codes the whole plane if the extrapolated size is at most this times the smallest.
_TRIAL_MARGIN = 1.05


def encode_plane(
    samples: Samples,
    bits: int,
    codecs: Collection[Codec] = PACKS["auto"],
    prior: PriorPlanes | None = None,
    memory: context.Memory | None = None,
) -> tuple[Codec, bytes]:
    """Code a plane with each of `codecs` and keep the smallest result.

    Args:
        samples: Shape (height, width), uint16, each less than 2**bits.
        bits: 1 to 16.
        codecs: Codecs to try; of equal sizes the first in `_ORDER` wins. If no codec can code the
            plane, as JPEG XL over 2048 samples in a row, deflate is used.
        prior: The prior planes; None = no prior planes.
        memory: Of a similar plane, for a quick choice; None = the best choice.

    Raises:
        ValueError: `samples` is not a uint16 plane, or a sample does not fit into `bits`.
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
                samples, shape, prior or PriorPlanes.none(shape.height, shape.width), memory
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
    """Whether a codec may take less than `best` bytes, extrapolated from the first rows."""
    rows = max(1, _TRIAL_SAMPLES // shape.width)
    if codec is Codec.RANGES or 2 * rows >= shape.height:
        return True
    part = _ENCODERS[codec](samples[:rows], PlaneShape(shape.width, rows, shape.bits))
    return part is not None and len(part) * shape.height <= _TRIAL_MARGIN * best * rows


@spec_section("6")
def decode_plane(
    codec: int,
    data: bytes,
    width: int,
    height: int,
    bits: int,
    limits: Limits,
    prior: PriorPlanes | None = None,
) -> Samples:
    """Decode a plane of known shape; the codec must use up `data` exactly.

    Args:
        codec: Number of the codec.
        data: Bytes of the coded plane.
        width: Samples in a row.
        height: Rows.
        bits: 1 to 16; every sample is less than 2**bits.
        limits: Limits on the content.
        prior: The prior planes; None = no prior planes.

    Returns:
        Shape (height, width), uint16, each sample less than 2**bits.

    Raises:
        UnsupportedError: The codec is not registered.
        LimitError: The plane is over `limits`; raised before anything is allocated.
        CorruptError: `data` is not a plane of this shape.
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
