"""The header chunk: properties of the whole file (spec section "Header chunk")."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from fractions import Fraction

from gsvrcodec.errors import CorruptError, UnsupportedError, spec_section
from gsvrcodec.limits import Limits
from gsvrcodec.model.reconstruction import Blending

VERSION_MAJOR = 1
VERSION_MINOR = 0

#: Must-understand flag: GOPs may hold plates.
PLATES_FLAG = 1
#: Must-understand flags that this version knows.
KNOWN_REQUIRED_FLAGS = PLATES_FLAG
#: Flag that may be ignored: planes coded as PNG or JPEG XL may occur.
IMAGE_CODECS_FLAG = 1
#: Flag that may be ignored: the file was written front to back, and may end without an index.
STREAM_FLAG = 2

#: A maximum of the header that is not known: as great as the field allows.
UNKNOWN_MAXIMUM = 2**32 - 1
UNKNOWN_GRID = (2**16 - 1,) * 3

_VERSION = struct.Struct("<HH")
_FLAGS = struct.Struct("<I")
_LAYOUT = struct.Struct("<HH IIIIII HBBBBBB II II HHH QI B")
HEADER_BYTES = _LAYOUT.size

#: Release candidates of this version that were withdrawn, by the bytes of their header.
_CANDIDATES = {70: "first", 72: "second"}
#: How pictures are formed, by number.
_BLENDINGS: tuple[Blending, ...] = ("sum", "mean")
_BLENDING_OFFSET = 70

#: Bit of the rotation field: the picture is mirrored before it is turned.
_MIRRORED = 0x8000


@dataclass(frozen=True, slots=True)
class ColourInfo:
    """Colour tags; code points of ITU-T H.273 (CICP)."""

    primaries: int = 2  #: colour primaries, 2 = not specified
    transfer: int = 2  #: transfer characteristics, 2 = not specified
    matrix: int = 2  #: matrix coefficients of the source's YCbCr, 2 = not specified
    full_range: bool = False  #: whether the source's YCbCr has full range
    chroma_location: int = 0  #: H.273 chroma sample location type + 1, 0 = not specified


@dataclass(frozen=True, slots=True, kw_only=True)
class Header:
    """Fields of the header chunk."""

    width: int  #: coded width, pixels
    height: int  #: coded height, pixels
    time_base: Fraction  #: seconds a tick
    sample_aspect: Fraction = Fraction(1)  #: width / height of a pixel
    rotation: int = 0  #: degrees clockwise that a player turns the picture by; 0, 90, 180 or 270
    mirrored: bool = False  #: whether a player mirrors the picture left to right before it turns it
    bit_depth: int = 8  #: bits of a sample of the source
    colour: ColourInfo = field(default_factory=ColourInfo)
    version_major: int = VERSION_MAJOR
    version_minor: int = VERSION_MINOR
    #: must-understand flags: a reader refuses a file with an unknown bit set
    flags_required: int = 0
    flags_optional: int = 0  #: flags that a reader may ignore
    #: most Gaussians in a GOP, those carried over included; `UNKNOWN_MAXIMUM` = not known
    max_gaussians: int = 0
    max_gop_frames: int = 0  #: most frames in a GOP; `UNKNOWN_MAXIMUM` = not known
    max_grid: tuple[int, int, int] = (0, 0, 0)  #: largest Gx, Gy, Gt; `UNKNOWN_GRID` = not known
    frames: int = 0  #: frames in the file, 0 = not known (the writer was not closed)
    gops: int = 0  #: GOPs in the file, 0 = not known
    blending: Blending = "mean"  #: how pictures are formed

    @property
    def version(self) -> str:
        """Bitstream version as text, major.minor."""
        return f"{self.version_major}.{self.version_minor}"

    @property
    def plates(self) -> bool:
        """Whether GOPs may hold plates."""
        return bool(self.flags_required & PLATES_FLAG)

    @property
    def image_codecs(self) -> bool:
        """Whether planes coded as PNG or JPEG XL may occur."""
        return bool(self.flags_optional & IMAGE_CODECS_FLAG)

    @property
    def stream(self) -> bool:
        """Whether the file was written front to back, and may end without an index."""
        return bool(self.flags_optional & STREAM_FLAG)

    def to_bytes(self) -> bytes:
        """The payload of the header chunk, always HEADER_BYTES long.

        Raises:
            ValueError: A field breaks a rule of the spec or does not fit its width.
        """
        problem = _problem(self)
        if problem:
            raise ValueError(problem)
        colour = self.colour
        try:
            return _LAYOUT.pack(
                self.version_major,
                self.version_minor,
                self.flags_required,
                self.flags_optional,
                self.width,
                self.height,
                self.sample_aspect.numerator,
                self.sample_aspect.denominator,
                self.rotation | _MIRRORED * self.mirrored,
                self.bit_depth,
                colour.primaries,
                colour.transfer,
                colour.matrix,
                colour.full_range,
                colour.chroma_location,
                self.time_base.numerator,
                self.time_base.denominator,
                self.max_gaussians,
                self.max_gop_frames,
                *self.max_grid,
                self.frames,
                self.gops,
                _BLENDINGS.index(self.blending),
            )
        except struct.error as error:
            raise ValueError(f"a header field is out of range: {error}") from error


@spec_section("4")
def parse_header(payload: bytes, limits: Limits) -> Header:
    """Read and check the payload of a header chunk.

    Raises:
        UnsupportedError: Another major version, a header of a release candidate, an unknown
            must-understand flag, or an unknown way to form pictures.
        LimitError: The picture or a maximum is over `limits`.
        CorruptError: A field breaks a rule of the spec.
    """
    if len(payload) < _VERSION.size:
        raise CorruptError(f"header of {len(payload)} bytes, expected {HEADER_BYTES}")
    major, minor = _VERSION.unpack_from(payload)
    if major != VERSION_MAJOR:
        raise UnsupportedError(
            f"the file has bitstream version {major}.{minor}, this decoder reads "
            f"{VERSION_MAJOR}.x (written for {VERSION_MAJOR}.{VERSION_MINOR})"
            + ": encode the video anew"
            * (major < VERSION_MAJOR)
        )
    if minor == 0 and len(payload) in _CANDIDATES:
        raise UnsupportedError(
            f"the file has bitstream version {major}.{minor} as of its {_CANDIDATES[len(payload)]} "
            "release candidate, "
            "which this decoder does not read: encode the video anew"
        )
    # A newer minor version may append fields; in our own version the length is fixed.
    newer = minor > VERSION_MINOR
    if len(payload) < HEADER_BYTES or (len(payload) > HEADER_BYTES and not newer):
        raise CorruptError(f"header of {len(payload)} bytes, expected {HEADER_BYTES}")
    # Before all other fields: what they mean may depend on the flags.
    (required,) = _FLAGS.unpack_from(payload, _VERSION.size)
    unknown = required & ~KNOWN_REQUIRED_FLAGS
    if unknown:
        raise UnsupportedError(
            f"the file needs features this decoder does not know (flags {unknown:#010x}, "
            f"version {major}.{minor}; this decoder is {VERSION_MAJOR}.{VERSION_MINOR})"
        )
    blending = payload[_BLENDING_OFFSET]
    if blending >= len(_BLENDINGS):
        raise UnsupportedError(
            f"the file forms its pictures in a way that this decoder does not know ({blending})"
        )
    header = _unpack(payload)
    problem = _problem(header)
    if problem:
        raise CorruptError(problem)
    limits.check("width", header.width, "the width")
    limits.check("height", header.height, "the height")
    limits.check("pixels", header.width * header.height, "the number of pixels")
    if header.max_gaussians != UNKNOWN_MAXIMUM:
        limits.check("gaussians", header.max_gaussians, "the number of Gaussians in a GOP")
    if header.max_gop_frames != UNKNOWN_MAXIMUM:
        limits.check("gop_frames", header.max_gop_frames, "the number of frames in a GOP")
    return header


def _unpack(payload: bytes) -> Header:
    (
        *versions_and_flags,
        width,
        height,
        aspect_num,
        aspect_den,
        rotation,
        bit_depth,
        primaries,
        transfer,
        matrix,
        full_range,
        chroma_location,
        base_num,
        base_den,
        max_gaussians,
        max_gop_frames,
        max_gx,
        max_gy,
        max_gt,
        frames,
        gops,
        blending,
    ) = _LAYOUT.unpack_from(payload)
    major, minor, required, optional = versions_and_flags
    if not (aspect_num and aspect_den):
        raise CorruptError(f"sample aspect ratio {aspect_num}/{aspect_den}")
    if not (base_num and base_den):
        raise CorruptError(f"time base {base_num}/{base_den}")
    if full_range > 1:
        raise CorruptError(f"colour range {full_range}, expected 0 or 1")
    return Header(
        version_major=major,
        version_minor=minor,
        flags_required=required,
        flags_optional=optional,
        width=width,
        height=height,
        sample_aspect=Fraction(aspect_num, aspect_den),
        rotation=rotation & ~_MIRRORED,
        mirrored=bool(rotation & _MIRRORED),
        bit_depth=bit_depth,
        colour=ColourInfo(primaries, transfer, matrix, bool(full_range), chroma_location),
        time_base=Fraction(base_num, base_den),
        max_gaussians=max_gaussians,
        max_gop_frames=max_gop_frames,
        max_grid=(max_gx, max_gy, max_gt),
        frames=frames,
        gops=gops,
        blending=_BLENDINGS[blending],
    )


def _problem(header: Header) -> str | None:
    """The first rule that the header breaks; None = it is valid."""
    if header.width < 1 or header.height < 1:
        return f"picture size {header.width}x{header.height}"
    if header.sample_aspect <= 0:
        return f"sample aspect ratio {header.sample_aspect}"
    if header.time_base <= 0:
        return f"time base {header.time_base}"
    if header.rotation not in (0, 90, 180, 270):
        return f"rotation {header.rotation}, expected 0, 90, 180 or 270"
    if not 1 <= header.bit_depth <= 16:
        return f"bit depth {header.bit_depth}, expected 1 to 16"
    if header.plates and header.blending == "sum":
        return "plates in a file whose pictures are sums"
    if header.colour.chroma_location > 6:
        return f"chroma location {header.colour.chroma_location}, expected 0 to 6"
    return None
