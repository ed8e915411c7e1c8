"""Sample aspect ratio of a Matroska file; FFmpeg's muxer does not get it from PyAV."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import NamedTuple

_SEGMENT, _TRACKS, _TRACK, _VIDEO = 0x18538067, 0x1654AE6B, 0xAE, 0xE0
_DISPLAY_UNIT, _VOID = 0x54B2, 0xEC

#: Bytes to read: enough for all elements before the first cluster.
_HEAD_BYTES = 2**20

#: Greatest display width or height, written with 16 bits.
_MAX_SIDE = 2**16 - 1


class _Element(NamedTuple):
    """An EBML element."""

    start: int  #: offset of the identifier
    content: int  #: offset of the content
    end: int  #: offset after the content


def set_sample_aspect(path: Path, size: tuple[int, int], aspect: Fraction) -> bool:
    """Write the display size, by the sample aspect ratio, into the first track of a file.

    The two elements replace padding that FFmpeg leaves behind the video properties; no other
    element moves.

    Args:
        path: A finished file of FFmpeg's muxer, without checksums.
        size: Width and height of the pictures, pixels.
        aspect: Width of a pixel over its height.

    Returns:
        Whether the file has room for the elements; False = the file is unchanged.
    """
    with path.open("r+b") as file:
        head = file.read(_HEAD_BYTES)
        try:
            track = _Element(0, 0, len(head))
            for kind in (_SEGMENT, _TRACKS, _TRACK):
                track = _find(head, track, kind)
            video, void = _find(head, track, _VIDEO), _find(head, track, _VOID)
            unit = _find(head, video, _DISPLAY_UNIT)
        except LookupError:
            return False
        shape = (size[0] * aspect / size[1]).limit_denominator(_MAX_SIDE)
        factor = max(1, size[1] // shape.denominator)
        sides = shape.numerator * factor, shape.denominator * factor
        if max(sides) > _MAX_SIDE or video.end > void.start:
            return False
        content = head[video.content : unit.start] + head[unit.end : video.end]
        content += b"\x54\xb0\x82" + sides[0].to_bytes(2) + b"\x54\xba\x82" + sides[1].to_bytes(2)
        moved = bytes([_VIDEO, 0x80 | len(content)]) + content + head[video.end : void.start]
        spare = void.end - video.start - len(moved) - 2
        if len(content) > 126 or not 0 <= spare <= 126:
            return False
        file.seek(video.start)
        file.write(moved + bytes([_VOID, 0x80 | spare]) + bytes(spare))
        return True


def _find(data: bytes, parent: _Element, kind: int) -> _Element:
    """Return the first child element of type `kind`; LookupError if `parent` has none."""
    start = parent.content
    while start < min(parent.end, len(data)):
        after_kind = start + _length(data, start)
        content = after_kind + _length(data, after_kind)
        length = int.from_bytes(data[after_kind:content])
        length &= (1 << 7 * (content - after_kind)) - 1
        if int.from_bytes(data[start:after_kind]) == kind:
            return _Element(start, content, content + length)
        start = content + length
    raise LookupError(hex(kind))


def _length(data: bytes, offset: int) -> int:
    """Return the length in bytes of the EBML number at `offset`, from its leading zero bits."""
    return 9 - data[offset].bit_length()
