"""The fixed start of a GOP's payload: all that a reader needs to seek (spec section "GOP head")."""

from __future__ import annotations

import struct
from dataclasses import dataclass

from gsvrcodec.bitstream.chunk import GOP_TYPE, ChunkEntry
from gsvrcodec.bitstream.header import Header
from gsvrcodec.errors import CorruptError

_SUMMARY = struct.Struct("<QIIqqQ")
_SHAPE = struct.Struct("<HHHHII")

SUMMARY_BYTES = _SUMMARY.size
GOP_HEAD_BYTES = _SUMMARY.size + _SHAPE.size

#: Timestamps and frame numbers stay below this, so that no sum of two overflows an int64.
TICKS_BOUND = 2**62


@dataclass(frozen=True, slots=True, kw_only=True)
class GopSummary:
    """Where a GOP lies in time; stands in the GOP's head and again in the index."""

    first_frame: int  #: number of its first frame, counted from 0 over the file
    frames: int  #: frames in it, at least 1
    gaussians: int  #: N
    start_pts: int  #: presentation timestamp of its first frame, ticks
    last_pts: int  #: presentation timestamp of its last frame, ticks
    last_duration: int  #: duration of its last frame, ticks, 0 = not known

    @property
    def end_frame(self) -> int:
        """Number of the first frame after it."""
        return self.first_frame + self.frames

    def summary_bytes(self) -> bytes:
        """The 40 bytes that GOP heads and index entries have in common."""
        return _SUMMARY.pack(
            self.first_frame,
            self.frames,
            self.gaussians,
            self.start_pts,
            self.last_pts,
            self.last_duration,
        )

    def check(self) -> None:
        """Raise a CorruptError if a field breaks a rule of the spec by itself."""
        if self.frames < 1:
            raise CorruptError("GOP of 0 frames")
        if self.end_frame > TICKS_BOUND:
            raise CorruptError(f"first frame is {self.first_frame}")
        if not -TICKS_BOUND < self.start_pts <= self.last_pts < TICKS_BOUND:
            raise CorruptError(f"timestamps {self.start_pts} to {self.last_pts}")
        if (self.frames == 1) != (self.start_pts == self.last_pts):
            raise CorruptError(
                f"{self.frames} frames from timestamp {self.start_pts} to {self.last_pts}"
            )
        if self.last_duration >= TICKS_BOUND:
            raise CorruptError(f"frame of {self.last_duration} ticks")

    def check_follows(self, previous: GopSummary | None) -> None:
        """Check that this GOP takes up where `previous` ends (None: that it is the first).

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


@dataclass(frozen=True, slots=True, kw_only=True)
class GopHead(GopSummary):
    """The first 56 bytes of a GOP's payload."""

    grid: tuple[int, int, int]  #: Gx, Gy, Gt; all 0 = no tri-plane
    planes: int  #: entries of the plane table
    background: int = 0  #: number of the background whose Gaussians it may show; 0 = none
    background_gaussians: int = 0  #: how many that background has

    @property
    def most_drawn(self) -> int:
        """Gaussians of its own and of its background."""
        return self.gaussians + self.background_gaussians

    def to_bytes(self) -> bytes:
        """The head as it stands in the file."""
        shape = _SHAPE.pack(*self.grid, self.planes, self.background, self.background_gaussians)
        return self.summary_bytes() + shape

    def check_maxima(self, header: Header) -> None:
        """Raise a CorruptError if the GOP is larger than the header's maxima say."""
        if self.most_drawn > header.max_gaussians:
            raise CorruptError(
                f"{self.most_drawn} Gaussians, the header's maximum is {header.max_gaussians}"
            )
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
    """A GOP of a file and where it lies."""

    offset: int  #: byte offset of its chunk
    size: int  #: bytes of its payload

    @property
    def chunk(self) -> ChunkEntry:
        """Its chunk."""
        return ChunkEntry(GOP_TYPE, self.offset, self.size)


def unpack_summary(data: bytes, chunk: ChunkEntry) -> GopEntry:
    """Read and check the 40 bytes at the start of `data`, which belong to the GOP in `chunk`."""
    first_frame, frames, gaussians, start, last, duration = _SUMMARY.unpack_from(data)
    entry = GopEntry(
        first_frame=first_frame,
        frames=frames,
        gaussians=gaussians,
        start_pts=start,
        last_pts=last,
        last_duration=duration,
        offset=chunk.offset,
        size=chunk.size,
    )
    entry.check()
    return entry


def parse_gop_head(payload: bytes) -> GopHead:
    """Read the first 56 bytes of a GOP's payload and check them by themselves.

    Raises:
        CorruptError: They are not all there, or break a rule of the spec.
    """
    if len(payload) < GOP_HEAD_BYTES:
        raise CorruptError(f"GOP of {len(payload)} bytes, its head alone takes {GOP_HEAD_BYTES}")
    first_frame, frames, gaussians, start, last, duration = _SUMMARY.unpack_from(payload)
    gx, gy, gt, planes, background, background_gaussians = _SHAPE.unpack_from(
        payload, _SUMMARY.size
    )
    head = GopHead(
        first_frame=first_frame,
        frames=frames,
        gaussians=gaussians,
        start_pts=start,
        last_pts=last,
        last_duration=duration,
        grid=(gx, gy, gt),
        planes=planes,
        background=background,
        background_gaussians=background_gaussians,
    )
    head.check()
    if (background == 0) != (background_gaussians == 0):
        raise CorruptError(f"background {background} of {background_gaussians} Gaussians")
    if any(head.grid) and not all(head.grid):
        raise CorruptError(f"tri-plane of {gx}x{gy}x{gt}, expected no size zero or all")
    return head
