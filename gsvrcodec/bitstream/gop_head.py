"""Head of a GOP's payload: what a reader needs for seeking (spec section "GOP head")."""

from __future__ import annotations

import struct
from collections.abc import Container
from dataclasses import dataclass

from gsvrcodec.bitstream.chunk import GOP_TYPE, ChunkEntry
from gsvrcodec.bitstream.header import VERSION_MINOR, Header
from gsvrcodec.errors import CorruptError, spec_section
from gsvrcodec.model.attributes import GopShape
from gsvrcodec.model.reconstruction import Blending

_SUMMARY = struct.Struct("<QIIqqQI")
_SHAPE = struct.Struct("<HHHHHHIIII")

_FIELDS = (
    "first_frame",
    "frames",
    "gaussians",
    "start_pts",
    "last_pts",
    "last_duration",
    "reference",
)
SUMMARY_BYTES = _SUMMARY.size
GOP_HEAD_BYTES = _SUMMARY.size + _SHAPE.size

#: Bound of timestamps and frame numbers: the sum of two of them does not overflow an int64.
TICKS_BOUND = 2**62
#: Bound of the ticks from the first to the last frame of a GOP: their double is exact in binary64.
SPAN_BOUND = 2**52


@dataclass(frozen=True, slots=True, kw_only=True)
class GopSummary:
    """Frames and timestamps of a GOP; stored in the GOP's head and again in the index."""

    first_frame: int  #: number of the GOP's first frame in the file, from 0
    frames: int  #: frames in the GOP, at least 1
    gaussians: int  #: Gaussians N of the GOP, those carried over included
    start_pts: int  #: presentation timestamp of the first frame, ticks
    last_pts: int  #: presentation timestamp of the last frame, ticks
    last_duration: int  #: duration of the last frame, ticks, 0 = not known
    #: frames from the first frame of the reference to that of this GOP; 0 = key GOP
    reference: int = 0

    @property
    def is_key(self) -> bool:
        """Whether the GOP needs no other."""
        return not self.reference

    @property
    def reference_frame(self) -> int:
        """Number of the first frame of the reference; of a key GOP its own."""
        return self.first_frame - self.reference

    @property
    def end_frame(self) -> int:
        """Number of the first frame after the GOP."""
        return self.first_frame + self.frames

    def summary_bytes(self) -> bytes:
        """The 44 bytes that GOP head and index entry have in common."""
        return _SUMMARY.pack(
            self.first_frame,
            self.frames,
            self.gaussians,
            self.start_pts,
            self.last_pts,
            self.last_duration,
            self.reference,
        )

    @spec_section("5.1")
    def check(self) -> None:
        """Raise a CorruptError if a field breaks a rule that needs no other GOP to check."""
        if self.frames < 1:
            raise CorruptError("GOP of 0 frames")
        if self.end_frame > TICKS_BOUND:
            raise CorruptError(f"first frame is {self.first_frame}")
        if not -TICKS_BOUND < self.start_pts <= self.last_pts < TICKS_BOUND:
            raise CorruptError(f"timestamps {self.start_pts} to {self.last_pts}")
        if self.last_pts - self.start_pts >= SPAN_BOUND:
            raise CorruptError(f"GOP from timestamp {self.start_pts} to {self.last_pts}")
        if (self.frames == 1) != (self.start_pts == self.last_pts):
            raise CorruptError(
                f"{self.frames} frames from timestamp {self.start_pts} to {self.last_pts}"
            )
        if self.last_duration >= TICKS_BOUND:
            raise CorruptError(f"frame of {self.last_duration} ticks")
        if self.reference > self.first_frame:
            raise CorruptError(f"reference {self.reference} frames before frame {self.first_frame}")

    @spec_section("5.1")
    def check_follows(self, previous: GopSummary | None) -> None:
        """Check that this GOP directly follows `previous`; None = this GOP must be the first.

        Raises:
            CorruptError: Frame numbers have a gap or overlap, or timestamps do not increase.
        """
        expected = previous.end_frame if previous else 0
        if self.first_frame != expected:
            raise CorruptError(f"first frame is {self.first_frame}, expected {expected}")
        if previous and self.start_pts <= previous.last_pts:
            raise CorruptError(
                f"timestamp {self.start_pts} does not come after {previous.last_pts}"
            )

    @spec_section("5.1")
    def check_reference(self, first_frames: Container[int]) -> None:
        """Check that the reference is one of the GOPs before, given by their first frames.

        Raises:
            CorruptError: No GOP before this one starts at the frame that the GOP refers to.
        """
        if not self.is_key and self.reference_frame not in first_frames:
            raise CorruptError(
                f"the GOP at frame {self.first_frame} refers to frame {self.reference_frame}, "
                "where no GOP starts"
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class GopHead(GopSummary):
    """The head of a GOP's payload."""

    grid: tuple[int, int, int]  #: Gx, Gy, Gt; all 0 = no tri-plane
    planes: int  #: entries of the plane table
    length: int = GOP_HEAD_BYTES  #: bytes of the head; more in files of newer versions
    carried_from: int = 0  #: Gaussians of the reference
    dropped: int = 0  #: of these, Gaussians that the GOP does not take over
    changed: int = 0  #: of these, Gaussians whose look changes
    moved: int = 0  #: of these, Gaussians that move
    plate: bool = False  #: whether the GOP stores a plate

    @property
    def new(self) -> int:
        """Gaussians that the GOP does not take over from its reference."""
        return self.gaussians - (self.carried_from - self.dropped)

    def shape(self, blending: Blending) -> GopShape:
        """Return counts and sizes, from which the planes follow; `blending` is the header's."""
        return GopShape(self.new, self.grid, self.carried_from, self.changed, self.moved, blending)

    def to_bytes(self) -> bytes:
        """The 72 bytes of the head that this version knows."""
        shape = _SHAPE.pack(
            self.length,
            self.planes,
            *self.grid,
            self.plate,
            self.carried_from,
            self.dropped,
            self.changed,
            self.moved,
        )
        return self.summary_bytes() + shape

    def entry(self, chunk: ChunkEntry) -> GopEntry:
        """The summary with the place of the GOP's chunk."""
        return GopEntry(
            **{name: getattr(self, name) for name in _FIELDS}, offset=chunk.offset, size=chunk.size
        )

    @spec_section("4")
    def check_maxima(self, header: Header) -> None:
        """Raise a CorruptError if the GOP exceeds a maximum of the header, or lacks its flag.

        Only in a file of a newer minor version may the head be longer than this version knows.
        """
        if self.length > GOP_HEAD_BYTES and header.version_minor <= VERSION_MINOR:
            raise CorruptError(f"GOP head of {self.length} bytes, expected {GOP_HEAD_BYTES}")
        if self.plate and not header.plates:
            raise CorruptError("a plate in a file whose header has not the flag of plates")
        most = max(self.gaussians, self.carried_from)
        if most > header.max_gaussians:
            raise CorruptError(f"{most} Gaussians, the header's maximum is {header.max_gaussians}")
        if self.frames > header.max_gop_frames:
            raise CorruptError(
                f"{self.frames} frames, the header's maximum is {header.max_gop_frames}"
            )
        if any(size > most for size, most in zip(self.grid, header.max_grid, strict=True)):
            raise CorruptError(
                f"tri-plane of {self.grid}, the header's maximum is {header.max_grid}"
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class GopEntry(GopSummary):
    """Summary of a GOP and the place of its chunk in the file."""

    offset: int  #: byte offset of the chunk
    size: int  #: bytes of the payload

    @property
    def chunk(self) -> ChunkEntry:
        """The GOP's chunk."""
        return ChunkEntry(GOP_TYPE, self.offset, self.size)


def unpack_summary(data: bytes, chunk: ChunkEntry) -> GopEntry:
    """Parse and check a summary, the first 44 bytes of `data`, of the GOP in `chunk`."""
    entry = GopEntry(**_summary(data), offset=chunk.offset, size=chunk.size)
    entry.check()
    return entry


@spec_section("5.1")
def parse_gop_head(payload: bytes) -> GopHead:
    """Parse the head at the start of a GOP's payload; its first 72 bytes suffice.

    Raises:
        CorruptError: The payload is shorter than the head, or a field breaks a rule of the spec.
    """
    if len(payload) < GOP_HEAD_BYTES:
        raise CorruptError(f"GOP of {len(payload)} bytes, its head alone takes {GOP_HEAD_BYTES}")
    length, planes, gx, gy, gt, plate, carried_from, dropped, changed, moved = _SHAPE.unpack_from(
        payload, _SUMMARY.size
    )
    head = GopHead(
        **_summary(payload),
        grid=(gx, gy, gt),
        planes=planes,
        length=length,
        carried_from=carried_from,
        dropped=dropped,
        changed=changed,
        moved=moved,
        plate=bool(plate),
    )
    head.check()
    if length < GOP_HEAD_BYTES:
        raise CorruptError(f"GOP head of {length} bytes, expected {GOP_HEAD_BYTES}")
    if plate > head.is_key:
        raise CorruptError(f"plate {plate} of a {'key' if head.is_key else 'predicted'} GOP")
    if carried_from and head.is_key:
        raise CorruptError(f"key GOP that carries {carried_from} Gaussians")
    kept = carried_from - dropped
    if not (0 <= kept <= head.gaussians and changed <= kept and moved <= kept):
        raise CorruptError(
            f"{head.gaussians} Gaussians of which {carried_from} - {dropped} are carried over, "
            f"{changed} changed and {moved} moved"
        )
    if any(head.grid) and not all(head.grid):
        raise CorruptError(f"tri-plane of {gx}x{gy}x{gt}, expected no size zero or all")
    return head


def _summary(data: bytes) -> dict[str, int]:
    """The fields of a summary."""
    return dict(zip(_FIELDS, _SUMMARY.unpack_from(data), strict=True))
