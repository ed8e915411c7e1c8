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

    number: int  #: by which GOPs name it, from 1, ascending in the file
    gaussians: int  #: how many it has, at least 1
    planes: int  #: entries of the plane table

    def to_bytes(self) -> bytes:
        """The head as it stands in the file."""
        return _HEAD.pack(self.number, self.gaussians, self.planes)


@dataclass(frozen=True, slots=True)
class BackgroundEntry(BackgroundHead):
    """A background of a file and where it lies."""

    chunk: ChunkEntry


def parse_background_head(payload: bytes) -> BackgroundHead:
    """Read the first 12 bytes of a background's payload and check them by themselves.

    Raises:
        CorruptError: They are not all there, or break a rule of the spec.
    """
    if len(payload) < BACKGROUND_HEAD_BYTES:
        raise CorruptError(
            f"background of {len(payload)} bytes, its head takes {BACKGROUND_HEAD_BYTES}"
        )
    head = BackgroundHead(*_HEAD.unpack_from(payload))
    if not head.number or not head.gaussians:
        raise CorruptError(f"background {head.number} of {head.gaussians} Gaussians")
    return head
