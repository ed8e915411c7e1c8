"""The parsers that read hostile bytes, each as a function of bytes, and inputs to begin with.

A target returns, or raises an error of gsvrcodec: anything else is a fault. `tests/fuzz_guided.py`
looks for inputs that reach new code, and `tests/corpus` holds those that it found.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import partial

import numpy as np

from gsvrcodec.bitstream.chunk import (
    GOP_TYPE,
    HEAD_TYPE,
    INDEX_TYPE,
    OVERHEAD_BYTES,
    SIGNATURE,
)
from gsvrcodec.bitstream.gop_payload import plane_table, unpack_gop
from gsvrcodec.bitstream.header import (
    HEADER_BYTES,
    IMAGE_CODECS_FLAG,
    UNKNOWN_GRID,
    UNKNOWN_MAXIMUM,
    Header,
    parse_header,
)
from gsvrcodec.bitstream.index import parse_index
from gsvrcodec.bitstream.refinement_bits import TABLE_BYTES, parse_table, unpack_numbers
from gsvrcodec.bitstream.tags import container_of, parse_settings, parse_tags
from gsvrcodec.bitstream.timing import pack_timing, unpack_timing
from gsvrcodec.errors import CorruptError
from gsvrcodec.limits import Limits
from gsvrcodec.planes.prior import PlaneStack
from gsvrcodec.planes.table import Codec, decode_plane
from tests import fuzz
from tests.gops import HEADER
from tests.tampering import pieces
from tests.vectors.make import VALID

Target = Callable[[bytes], object]

#: A header that all GOPs of means keep to, and one for those of sums.
MEANS = Header(
    width=64,
    height=48,
    time_base=HEADER.time_base,
    flags_optional=IMAGE_CODECS_FLAG,
    max_gaussians=UNKNOWN_MAXIMUM,
    max_gop_frames=UNKNOWN_MAXIMUM,
    max_grid=UNKNOWN_GRID,
)
SUMS = replace(MEANS, blending="sum")
#: Where the first chunk behind the header starts.
_FIRST_CHUNK = len(SIGNATURE) + OVERHEAD_BYTES + HEADER_BYTES
#: Streams that the parsers' inputs are taken from.
NAMES = (
    *("minimal", "black-triplane", "variable-rate", "levels-1x1", "stream", "deflate", "png"),
    *("jxl", "entropy", "predicted", "predicted-entropy", "predicted-refined", "sixteen-bits"),
    *("sixteen-bits-entropy", "opacities", "sum", "predicted-sum"),
)


def _index(data: bytes) -> None:
    """Where the index starts, then its payload."""
    parse_index(data[8:], _FIRST_CHUNK, int.from_bytes(data[:8], "little"), fuzz.LIMITS)


def _timing(data: bytes) -> None:
    """Frames of the GOP and its first timestamp, then the table."""
    frames, start = struct.unpack("<Hq", data[:10].ljust(10, b"\0"))
    unpack_timing(data, 10, start, max(frames, 1))


def _refinement(data: bytes) -> None:
    """The table, then numbers of 0 to 8 bits for 20 Gaussians."""
    parse_table(data[:TABLE_BYTES])
    unpack_numbers(data[TABLE_BYTES:], np.arange(20, dtype=np.int8) % 9)


def _plane(codec: Codec, data: bytes) -> None:
    """Width, height, bits and prior planes, then the plane."""
    width, height, bits, prior = data[:4].ljust(4, b"\0")
    stack = PlaneStack(prior % 4, height or 1, width or 1, guided=prior >= 128)
    draw = np.random.default_rng(0)
    for _ in range(prior % 4):
        stack.append(draw.integers(0, 2**12, (height or 1, width or 1)).astype(np.uint16))
    samples = decode_plane(codec, data[4:], width, height, bits, fuzz.LIMITS, stack.prior)
    if samples.shape != (height, width) or samples.max() >> bits:
        raise AssertionError(f"samples of shape {samples.shape} up to {samples.max()}")


def _json(data: bytes) -> None:
    """Settings, tags, and the container of a copied stream."""
    for parse in (parse_settings, parse_tags, container_of):
        with suppress(CorruptError):
            parse(data)


def _file(data: bytes) -> None:
    fuzz.decoded(data)


def _repaired(data: bytes) -> None:
    """A file whose checksums are made right."""
    fuzz.decoded(fuzz.repaired(data))


TARGETS: Mapping[str, Target] = {
    "file": _file,
    "repaired": _repaired,
    "header": lambda data: parse_header(data, Limits()),
    "index": _index,
    "gop": lambda data: unpack_gop(data, MEANS, fuzz.LIMITS),
    "gop_of_sum": lambda data: unpack_gop(data, SUMS, fuzz.LIMITS),
    "timing": _timing,
    "refinement": _refinement,
    **{
        codec.name.lower(): partial(_plane, codec)
        for codec in (Codec.DEFLATE, Codec.PNG, Codec.JXL, Codec.CONTEXT, Codec.RANGES)
    },
    "json": _json,
}


def seeds(target: str) -> Iterator[bytes]:
    """Sound inputs of a target."""
    for name in NAMES:
        data = (VALID / f"{name}.gsvr").read_bytes()
        chunks = pieces(data)
        header = SUMS if name in ("sum", "predicted-sum") else MEANS
        payloads = [piece.payload for piece in chunks if piece.type == GOP_TYPE]
        if target in ("file", "repaired"):
            yield data
        elif target == "header":
            yield chunks[0].payload if chunks[0].type == HEAD_TYPE else b""
        elif target == "index":
            for piece in chunks:
                if piece.type == INDEX_TYPE:
                    yield chunks[-1].payload[:8] + piece.payload
        elif target in ("gop", "gop_of_sum"):
            if header is (MEANS if target == "gop" else SUMS):
                yield from payloads
        elif target == "timing":
            pts = np.cumsum([0, 33, 33, 34, 100])
            yield struct.pack("<Hq", 5, 0) + pack_timing(pts, np.full(5, 33))
        elif target == "refinement":
            yield bytes(TABLE_BYTES + 10)
        elif target == "json":
            yield b'{"film": {"title": "a"}, "streams": [{"tags": {}, "disposition": 1}]}'
            yield b'{"chapters": [{"start": [0, 1], "stop": [1, 2], "tags": {}}]}'
        else:
            yield from _planes(Codec[target.upper()], payloads, header)


def _planes(codec: Codec, payloads: list[bytes], header: Header) -> Iterator[bytes]:
    """Coded planes of a codec."""
    for payload in payloads:
        entries, offset, _ = plane_table(payload, header, Limits())
        for entry in entries:
            if entry.codec == codec:
                shape = bytes([entry.width, entry.height, entry.quantiser.bits, 0])
                yield shape + payload[offset : offset + entry.size]
            offset += entry.size
