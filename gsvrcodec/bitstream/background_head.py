"""The fixed start of a background's payload (spec section "Background chunk")."""

from __future__ import annotations

import struct
from dataclasses import dataclass

from gsvrcodec.bitstream.chunk import ChunkEntry
from gsvrcodec.errors import CorruptError

_HEAD = struct.Struct("<III")

BACKGROUND_HEAD_BYTES = _HEAD.size


@dataclass(frozen=True, slots=True)
class BackgroundHead:
    """The first 12 bytes of a background's payload."""

    number: int  #: number by which GOPs refer to the background; from 1, ascending in the file
    gaussians: int  #: Gaussians in the background, at least 1
    planes: int  #: entries of the plane table

    def to_bytes(self) -> bytes:
        """The 12 bytes of the head."""
        return _HEAD.pack(self.number, self.gaussians, self.planes)


@dataclass(frozen=True, slots=True)
class BackgroundEntry(BackgroundHead):
    """Head of a background and the place of its chunk in the file."""

    chunk: ChunkEntry


def parse_background_head(payload: bytes) -> BackgroundHead:
    """Parse the head at the start of a background's payload.

    Raises:
        CorruptError: The payload is shorter than the head, or a field breaks a rule of the spec.
    """
    if len(payload) < BACKGROUND_HEAD_BYTES:
        raise CorruptError(
            f"background of {len(payload)} bytes, its head takes {BACKGROUND_HEAD_BYTES}"
        )
    head = BackgroundHead(*_HEAD.unpack_from(payload))
    if not head.number or not head.gaussians:
        raise CorruptError(f"background {head.number} of {head.gaussians} Gaussians")
    return head
