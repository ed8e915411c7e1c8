"""Checks the head of a JPEG XL codestream (ISO/IEC 18181-1) before a library sees it.

A codestream may hold animations, layers, alpha, previews, splines and colour transforms, and say
any size. A plane needs none of that: one modular frame of grey integers, of the size known before.
"""

from __future__ import annotations

from gsvrcodec.errors import CorruptError
from gsvrcodec.planes.samples import Shape

_SIGNATURE = b"\xff\x0a"
#: No head that we allow is longer; only so many bytes are looked at.
_MAX_HEAD_BYTES = 64

_GREY = 1
_CUSTOM_WHITE_POINT = 2
#: The only frame flag allowed; it has no meaning for a modular frame, yet encoders set it.
_SKIP_LF_SMOOTHING = 128

#: U32 distributions: (bits, offset) for each of the four selectors.
_SIZE = ((9, 1), (13, 1), (18, 1), (30, 1))
_DEPTH = ((0, 8), (0, 10), (0, 12), (6, 1))
_EXTRA_CHANNELS = ((0, 0), (0, 1), (4, 2), (12, 1))
_ENUM = ((0, 0), (0, 1), (4, 2), (6, 18))
_RATIOS = ((1, 1), (12, 10), (4, 3), (3, 2), (16, 9), (5, 4), (2, 1))


class _Bits:
    """Reads bits, the lowest of each byte first."""

    def __init__(self, data: bytes):
        self._value = int.from_bytes(data, "little")
        self._left = 8 * len(data)
        self._position = 0

    def take(self, count: int) -> int:
        """The next `count` bits."""
        if count > self._left:
            raise CorruptError("JPEG XL head cut short")
        value = self._value & ((1 << count) - 1)
        self._value >>= count
        self._left -= count
        self._position += count
        return value

    def u32(self, distributions: tuple[tuple[int, int], ...]) -> int:
        """A number in one of four ranges, chosen by two bits."""
        bits, offset = distributions[self.take(2)]
        return self.take(bits) + offset

    def u64(self) -> int:
        """A number of up to 8 bits and a little; longer ones, which no field here needs, fail."""
        selector = self.take(2)
        if selector == 3:
            raise CorruptError("JPEG XL head with an unexpected 64-bit number")
        return self.take(4 * selector) + (0, 1, 17)[selector]

    def align(self) -> None:
        """Skip to the next byte; the bits between must be zero."""
        if self.take(-self._position % 8):
            raise CorruptError("JPEG XL head with non-zero padding")


def check_codestream(data: bytes, shape: Shape) -> None:
    """Refuse a codestream whose head is not that of a grey, lossless plane of this shape.

    Raises:
        CorruptError: It is not.
    """
    if not data.startswith(_SIGNATURE):
        raise CorruptError("not a bare JPEG XL codestream")
    bits = _Bits(data[len(_SIGNATURE) : _MAX_HEAD_BYTES])
    width, height = _size(bits)
    if (width, height) != (shape.width, shape.height):
        raise CorruptError(
            f"JPEG XL image of {width}x{height}, expected {shape.width}x{shape.height}"
        )
    _check_metadata(bits, 8 * shape.stored_bytes)
    bits.align()
    _check_frame(bits)


def _size(bits: _Bits) -> tuple[int, int]:
    small = bits.take(1)
    height = 8 * (bits.take(5) + 1) if small else bits.u32(_SIZE)
    ratio = bits.take(3)
    if ratio:
        numerator, denominator = _RATIOS[ratio - 1]
        return height * numerator // denominator, height
    return 8 * (bits.take(5) + 1) if small else bits.u32(_SIZE), height


def _check_metadata(bits: _Bits, depth: int) -> None:
    """ImageMetadata and the transform data after it."""
    _need(not bits.take(1), "default metadata")
    _need(not bits.take(1), "a preview, animation or orientation")
    _need(not bits.take(1), "floating-point samples")
    found = bits.u32(_DEPTH)
    _need(found == depth, f"{found} bits, expected {depth}")
    bits.take(1)  # Whether 16-bit buffers suffice: a hint.
    _need(bits.u32(_EXTRA_CHANNELS) == 0, "extra channels")
    _need(not bits.take(1), "lossy (XYB) coding")
    _need(not bits.take(1), "default colour")
    _need(not bits.take(1), "an ICC profile")
    _need(bits.u32(_ENUM) == _GREY, "colour")
    _need(bits.u32(_ENUM) != _CUSTOM_WHITE_POINT, "a custom white point")
    if bits.take(1):
        bits.take(24)  # Gamma
    else:
        bits.u32(_ENUM)  # Transfer function
    bits.u32(_ENUM)  # Rendering intent
    _need(bits.u64() == 0, "extensions")
    _need(bits.take(1) == 1, "custom transform data")


def _check_frame(bits: _Bits) -> None:
    """FrameHeader as far as the field that says this is the last frame."""
    _need(not bits.take(1), "lossy (VarDCT) coding")
    _need(bits.take(2) == 0, "a frame that is not shown")
    _need(bits.take(1) == 1, "lossy (VarDCT) coding")
    _need(bits.u64() & ~_SKIP_LF_SMOOTHING == 0, "noise, patches or splines")
    _need(not bits.take(1), "YCbCr")
    _need(bits.take(2) == 0, "upsampling")
    bits.take(2)  # Group size
    _need(bits.take(2) == 0, "several passes")
    _need(not bits.take(1), "a cropped frame")
    _need(bits.take(2) == 0, "blending")
    _need(bits.take(1) == 1, "several frames")


def _need(condition: bool, what: str) -> None:
    if not condition:
        raise CorruptError(f"JPEG XL codestream with {what}")
