"""The worked example of the spec: every byte of the smallest vector, and what it is."""

from __future__ import annotations

from gsvrcodec.bitstream.gop_head import GOP_HEAD_BYTES
from gsvrcodec.model.attributes import ATTRIBUTES


def hex_dump(data: bytes) -> str:
    """The worked example of the spec: offset, bytes, what they are."""
    parts: list[tuple[int, str]] = [(8, "signature")]

    def chunk(name: str, payload: list[tuple[int, str]]) -> None:
        size = sum(length for length, _ in payload)
        parts.extend([(4, f"type {name}"), (8, f"length {size}"), (4, "CRC of the head")])
        parts.extend(payload)
        parts.append((4, "CRC of the payload"))

    names = [
        a.name if a.components == 1 else f"{a.name}.{part}"
        for a in ATTRIBUTES
        if a.grid == "gaussians"
        for part in range(a.components)
    ]
    summary = [
        (8, "first frame 0"),
        (4, "frames 1"),
        (4, "Gaussians 1"),
        (8, "first timestamp 0"),
        (8, "last timestamp 0"),
        (8, "last duration 1"),
        (4, "key GOP"),
    ]
    chunk(
        "HEAD",
        [
            (4, "version 1.0"),
            (8, "flags"),
            (8, "size 16x8"),
            (8, "sample aspect 1/1"),
            (3, "rotation 0, bit depth 8"),
            (5, "colour not specified"),
            (8, "time base 1/25"),
            (8, "at most 1 Gaussian, 1 frame"),
            (6, "no tri-plane"),
            (8, "1 frame"),
            (4, "1 GOP"),
            (1, "pictures are means"),
        ],
    )
    timing = [(3, "timing: 1 frame, step 1, duration 1")]
    shape = [
        (4, "72 bytes, 14 planes"),
        (6, "Gx, Gy, Gt"),
        (2, "reserved"),
        (8, "carries 0, drops 0"),
        (8, "changes 0, moves 0"),
    ]
    table = [(5, f"plane {name}") for name in names]
    planes = [(2, f"samples of {name}") for name in names]
    refinement = [(12, "no refinement")]
    chunk("GOPD", [*summary, *shape, *timing, *table, *planes, *refinement])
    gop_size = GOP_HEAD_BYTES + 3 + 7 * len(names) + 12
    chunk("indx", [(4, "1 entry"), (4, "type GOPD"), (8, f"length {gop_size}"), *summary])
    chunk("fend", [(8, f"index at byte {99 + 20 + gop_size}"), (8, f"file of {len(data)} bytes")])
    lines = []
    offset = 0
    for length, what in parts:
        for begin in range(0, length, 10):
            piece = data[offset + begin : offset + min(begin + 10, length)]
            lines.append(f"    {offset + begin:04x}  {piece.hex(' '):<29}  {what}".rstrip())
            what = ""
        offset += length
    if offset != len(data):
        raise ValueError(f"the dump has {offset} bytes, the file {len(data)}")
    return "\n".join(lines)
