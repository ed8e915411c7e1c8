"""Checks headers and length of a JPEG XL codestream (ISO/IEC 18181-1) before libjxl gets it.

A general codestream may have any size and hold animations, layers, alpha, previews, splines and
colour transforms. A plane is restricted to one modular frame of grey integers of known size.
"""

from __future__ import annotations

from gsvrcodec.errors import CorruptError
from gsvrcodec.planes.samples import PlaneShape

_SIGNATURE = b"\xff\x0a"
_GREY = 1
_CUSTOM_WHITE_POINT = 2
#: The only frame flag allowed: without effect in a modular frame, but set by encoders.
_SKIP_LF_SMOOTHING = 128

#: U32 distributions: (bits, offset) for each of the four selectors.
_SIZE = ((9, 1), (13, 1), (18, 1), (30, 1))
_DEPTH = ((0, 8), (0, 10), (0, 12), (6, 1))
_EXTRA_CHANNELS = ((0, 0), (0, 1), (4, 2), (12, 1))
_ENUM = ((0, 0), (0, 1), (4, 2), (6, 18))
_SECTION = ((10, 0), (14, 1024), (22, 17408), (30, 4211712))
_RATIOS = ((1, 1), (12, 10), (4, 3), (3, 2), (16, 9), (5, 4), (2, 1))


class _Bits:
    """Bit reader, the lowest bit of each byte first."""

    def __init__(self, data: bytes):
        self._data = data
        self._position = 0

    def take(self, count: int) -> int:
        """The next `count` bits."""
        first, end = self._position // 8, self._position + count
        if end > 8 * len(self._data):
            raise CorruptError("JPEG XL codestream cut short in its head")
        window = int.from_bytes(self._data[first : (end + 7) // 8], "little")
        value = window >> self._position % 8 & ((1 << count) - 1)
        self._position = end
        return value

    def u32(self, distributions: tuple[tuple[int, int], ...]) -> int:
        """A U32 field: two bits choose one of four (bits, offset) distributions."""
        bits, offset = distributions[self.take(2)]
        return self.take(bits) + offset

    def u64(self) -> int:
        """A U64 field up to 272; no field here needs more, larger values raise a CorruptError."""
        selector = self.take(2)
        if selector == 3:
            raise CorruptError("JPEG XL head with an unexpected 64-bit number")
        return self.take(4 * selector) + (0, 1, 17)[selector]

    def align(self) -> None:
        """Skip to the next byte; the skipped bits must be zero."""
        if self.take(-self._position % 8):
            raise CorruptError("JPEG XL head with non-zero padding")

    @property
    def offset(self) -> int:
        """Bytes read; call at a byte boundary."""
        return self._position // 8


def check_codestream(data: bytes, shape: PlaneShape) -> None:
    """Check that `data` is exactly one codestream of a grey, lossless plane of this shape.

    Raises:
        CorruptError: A field of the headers, or the length, is not as the spec requires.
    """
    if not data.startswith(_SIGNATURE):
        raise CorruptError("not a bare JPEG XL codestream")
    bits = _Bits(data)
    bits.take(8 * len(_SIGNATURE))
    width, height = _size(bits)
    if (width, height) != (shape.width, shape.height):
        raise CorruptError(
            f"JPEG XL image of {width}x{height}, expected {shape.width}x{shape.height}"
        )
    _check_metadata(bits, 8 * shape.stored_bytes)
    bits.align()
    group = _check_frame(bits)
    end = _sections_end(bits, _sections(shape, group))
    if end != len(data):
        raise CorruptError(f"JPEG XL codestream of {end} bytes in a plane of {len(data)} bytes")


def _size(bits: _Bits) -> tuple[int, int]:
    small = bits.take(1)
    height = 8 * (bits.take(5) + 1) if small else bits.u32(_SIZE)
    ratio = bits.take(3)
    if ratio:
        numerator, denominator = _RATIOS[ratio - 1]
        return height * numerator // denominator, height
    return 8 * (bits.take(5) + 1) if small else bits.u32(_SIZE), height


def _check_metadata(bits: _Bits, depth: int) -> None:
    """Check ImageMetadata and the transform data."""
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


def _check_frame(bits: _Bits) -> int:
    """Check FrameHeader; return width and height of a group, pixels."""
    _need(not bits.take(1), "lossy (VarDCT) coding")
    _need(bits.take(2) == 0, "a frame that is not shown")
    _need(bits.take(1) == 1, "lossy (VarDCT) coding")
    _need(bits.u64() & ~_SKIP_LF_SMOOTHING == 0, "noise, patches or splines")
    _need(not bits.take(1), "YCbCr")
    _need(bits.take(2) == 0, "upsampling")
    group = 128 << bits.take(2)
    _need(bits.take(2) == 0, "several passes")
    _need(not bits.take(1), "a cropped frame")
    _need(bits.take(2) == 0, "blending")
    _need(bits.take(1) == 1, "several frames")
    _need(bits.take(2) == 0, "a name")
    _need(bits.take(1) == 0, "smoothing")  # All default: with filters
    _need(bits.take(1) == 0, "smoothing")  # Gaborish
    _need(bits.take(2) == 0, "smoothing")  # Edge-preserving
    _need(bits.u64() == 0, "extensions")
    _need(bits.u64() == 0, "extensions")
    return group


def _sections(shape: PlaneShape, group: int) -> int:
    """Number of sections of a frame of one pass."""

    def tiles(size: int) -> int:
        return -(-shape.width // size) * -(-shape.height // size)

    groups = tiles(group)
    return 1 if groups == 1 else 2 + tiles(8 * group) + groups


def _sections_end(bits: _Bits, sections: int) -> int:
    """Read the table of contents and return the offset at which the last section ends."""
    _need(not bits.take(1), "permuted sections")
    bits.align()
    total = sum(bits.u32(_SECTION) for _ in range(sections))
    bits.align()
    return bits.offset + total


def _need(condition: bool, what: str) -> None:
    if not condition:
        raise CorruptError(f"JPEG XL codestream with {what}")
