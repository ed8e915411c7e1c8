"""Registry of plane codecs, and the choice of the smallest (spec section "Plane codecs")."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.errors import CorruptError, UnsupportedError
from gsvrcodec.limits import Limits
from gsvrcodec.native import _entropy
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
#: The codecs that libraries decode; they need no prior planes.
_DECODERS: Mapping[Codec, Callable[[bytes, PlaneShape], Samples]] = {
    Codec.DEFLATE: deflate.decode,
    Codec.PNG: png.decode,
    Codec.JXL: jxl.decode,
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


class Stack(NamedTuple):
    """The planes of one grid, in table order."""

    samples: NDArray[np.uint16]  #: (count, height, width)
    guided: bool = False  #: whether the first plane chooses neighbours, see `PlaneStack`


class CodedPlane(NamedTuple):
    """A plane to decode."""

    codec: Codec
    bits: int  #: 1 to 16; every sample is less than 2**bits
    offset: int  #: of its bytes
    size: int  #: bytes
    stack: int  #: number of its stack
    place: int  #: in the stack; the planes before it are its prior planes


class DamagedPlane(Exception):
    """A plane breaks a rule of its codec."""

    def __init__(self, number: int, error: CorruptError) -> None:
        super().__init__(error.message)
        error.section = error.section or "6"
        self.number = number  #: of the plane, from 0
        self.error = error  #: which rule


def decode_planes(data: bytes, planes: Sequence[CodedPlane], stacks: Sequence[Stack]) -> None:
    """Decode planes to their places in stacks; the codecs must use up their bytes exactly.

    Args:
        data: Holds the bytes of the planes.
        planes: The planes; those of a stack in the order of their places.
        stacks: Where samples are written to.

    Raises:
        DamagedPlane: The bytes of a plane are not a plane of this shape.
    """
    own: list[int] = []
    for number, plane in enumerate(planes):
        if plane.codec not in _DECODERS:
            own.append(number)
            continue
        samples = stacks[plane.stack].samples
        shape = PlaneShape(samples.shape[2], samples.shape[1], plane.bits)
        try:
            samples[plane.place] = _DECODERS[plane.codec](
                data[plane.offset : plane.offset + plane.size], shape
            )
        except CorruptError as error:
            raise DamagedPlane(number, error) from error
    if fault := _entropy.decode_planes(data, [planes[number] for number in own], stacks):
        number = own[fault[0]]
        name = planes[number].codec.name.lower()
        raise DamagedPlane(number, CorruptError(f"damaged {name} plane: {fault[1]}"))


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
        raise CorruptError(f"plane of {width}x{height} samples of {bits} bits", section="6")
    limits.check("plane_samples", width * height, "the number of samples of a plane")
    before = (prior or PriorPlanes.none(height, width)).planes
    samples = np.concatenate([before, np.empty((1, height, width), np.uint16)])
    stack = Stack(samples, prior is not None and prior.columns is not None)
    try:
        decode_planes(data, [CodedPlane(known, bits, 0, len(data), 0, len(before))], [stack])
    except DamagedPlane as damaged:
        raise damaged.error from None
    decoded: Samples = samples[-1]
    return decoded
