"""Files that a decoder must refuse or recover: one fault each, all other checksums right."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, replace

import imagecodecs
import numpy as np

from gsvrcodec.bitstream.chunk import END_TYPE, GOP_TYPE, HEAD_TYPE, INDEX_TYPE, SIGNATURE
from gsvrcodec.bitstream.gop_head import GOP_HEAD_BYTES, SUMMARY_BYTES, parse_gop_head
from gsvrcodec.bitstream.gop_payload import pack_gop
from gsvrcodec.bitstream.header import PLATES_FLAG
from gsvrcodec.bitstream.refinement_bits import TABLE_BYTES
from gsvrcodec.model.quantise import step_number
from tests.gops import BITS, HEADER, make_chain, make_file, make_gop, make_payload, make_payloads
from tests.tampering import MODES, TABLE_OFFSET, Piece, joined, patched, pieces, with_plane
from tests.vectors.streams import a_plate

#: Offset of the field that announces a plate.
PLATE = SUMMARY_BYTES + 10


@dataclass(frozen=True)
class Fault:
    """A broken file and how a decoder must take it."""

    name: str
    data: bytes
    says: str  #: part of what is said of it


def faulty_vectors() -> Iterator[Fault]:
    """All broken files, one fault each."""
    good = make_file(make_payloads(2), auxiliary=((b"sett", b"{}"),))
    chunks = pieces(good)
    head, first, second = chunks[0], chunks[1], chunks[2]
    gop = first.payload

    def header(name: str, offset: int, layout: str, *values: int, says: str) -> Fault:
        return Fault(name, patched(good, HEAD_TYPE, offset, layout, *values), says)

    def in_gop(name: str, offset: int, layout: str, *values: int, says: str) -> Fault:
        return Fault(name, patched(good, GOP_TYPE, offset, layout, *values), says)

    def plane(name: str, data: bytes, says: str, **changes: int) -> Fault:
        payload = with_plane(gop, 0, data, **changes)
        return Fault(name, joined([head, Piece(GOP_TYPE, payload), second]), says)

    yield Fault("empty", b"", "empty")
    yield Fault("text", b"This is not a video.\n", "not a .gsvr file")
    yield Fault("cut-signature", SIGNATURE[:5], "ends inside the signature")
    yield Fault("crlf-to-lf", good.replace(b"\r\n", b"\n"), "line ends")
    yield Fault("seven-bit", bytes(byte & 0x7F for byte in good), "7-bit")
    yield Fault("no-header", joined(chunks[1:]), "expected HEAD")
    yield Fault("second-header", joined([head, head, first]), "second header")
    yield Fault("no-gop", joined([head]), "no whole GOP")
    yield Fault("no-index", joined(chunks[:3], reindex=False), "has no end")
    yield Fault("cut-gop", good[: good.index(second.to_bytes()) + 99], "past the end")
    yield Fault("trailing-bytes", good + b"more", "after the end of the file")
    yield Fault("flipped-payload", _flip(good, good.index(gop) + 70), "CRC mismatch")
    yield Fault("flipped-chunk-head", _flip(good, good.index(gop) - 8), "CRC mismatch")
    yield Fault("critical-chunk", joined([head, first, Piece(b"Nope", b"")]), "chunk Nope")
    yield header("major-version", 0, "H", 2, says="version 2.0")
    yield header("version-0.6", 0, "HH", 0, 6, says="reads 1.x (written for 1.0): encode")
    yield header("required-flag", 4, "I", 1 << 31, says="flags 0x80000000")
    yield header("flag-before-size", 4, "III", 2, 0, 0, says="flags 0x00000002")
    yield header("zero-width", 12, "I", 0, says="picture size 0x48")
    yield header("zero-time-base", 36, "I", 0, says="time base 0/1000")
    yield header("zero-aspect", 24, "I", 0, says="aspect ratio 1/0")
    yield header("rotation", 28, "H", 45, says="rotation 45")
    yield header("huge-picture", 12, "II", 32768, 32768, says="number of pixels")
    yield header("gaussians-over-maximum", 44, "I", 4, says="header's maximum is 4")
    yield header("frames-over-maximum", 48, "I", 2, says="header's maximum is 2")
    yield header("blending", 70, "B", 2, says="does not know (2)")
    yield header("blending-of-others", 70, "B", 0, says="14 planes, expected 13")
    for name, length in (("first", 70), ("second", 72)):
        older = Piece(HEAD_TYPE, (head.payload + b"\0")[:length])
        says = f"{name} release candidate"
        yield Fault(f"{name}-release-candidate", joined([older, first, second]), says)
    short = Piece(HEAD_TYPE, head.payload[:69])
    yield Fault("header-too-short", joined([short, first]), "69 bytes")
    yield header("wrong-count", 58, "Q", 99, says="the header says 99 frames")
    yield Fault(
        "index-sizes-swapped",
        patched(good, INDEX_TYPE, 8, "Q", len(second.payload) + 1),
        "no valid index",
    )
    count = patched(good, INDEX_TYPE, 0, "I", 2**16 + 1)
    yield Fault("index-count", count, "no valid index")
    yield Fault("index-frame-gap", patched(good, INDEX_TYPE, 72, "Q", 4), "expected 3")
    yield Fault("index-lies", patched(good, INDEX_TYPE, 28, "I", 1), "the index names")
    yield Fault("end-lies", patched(good, END_TYPE, 0, "Q", 2**64 - 1), "no valid index")
    yield Fault("zero-frames", patched(good, GOP_TYPE, 8, "I", 0), "GOP of 0 frames")
    yield in_gop("zero-step", GOP_HEAD_BYTES + 1, "B", 0, says="step 0")
    yield in_gop("run-too-long", GOP_HEAD_BYTES, "B", 4, says="timing run of 4 frames")
    yield in_gop("half-triplane", SUMMARY_BYTES + 4, "H", 2, says="tri-plane of 2x0x0")
    yield in_gop("head-too-long", SUMMARY_BYTES, "H", 73, says="GOP head of 73 bytes")
    yield in_gop("head-too-short", SUMMARY_BYTES, "H", 71, says="GOP head of 71 bytes")
    yield in_gop("plate-number", PLATE, "H", 2, says="plate 2 of a key GOP")
    yield in_gop("plate-without-flag", PLATE, "H", 1, says="has not the flag of plates")
    yield in_gop("plane-count", SUMMARY_BYTES + 2, "H", 13, says="13 planes, expected 14")
    yield in_gop("plane-table-cut", SUMMARY_BYTES + 2, "H", 9999, says="plane table")
    yield plane("step-over-bound", b"", "allowed is -1024 to 1024", step=2**16 - 1)
    yield plane("first-over-bound", b"", "allowed is -1024 to 1024", first=-(2**31))
    yield plane("first-too-large", b"", "more than 32 bits", first=2**31)
    yield plane("plane-size", b"", "planes end at byte", size=2**32 - 1)
    yield plane("plane-size-too-large", b"", "more than 32 bits", size=2**32)
    none = with_plane(gop, 0, b"", first=0)
    overlong = none[: TABLE_OFFSET + 3] + b"\x80\0" + none[TABLE_OFFSET + 4 :]
    overlong = joined([head, Piece(GOP_TYPE, overlong), second])
    yield Fault("first-overlong", overlong, "overlong number")
    yield plane("unknown-codec", b"", "plane codec 9", codec=9)
    yield plane("constant-too-large", b"\x10\x00", "sample 16", codec=0, bits=4)
    half = step_number(0.5)
    opacity = with_plane(gop, 8, bytes(2), codec=0, bits=1, first=24, step=half)
    over = joined([head, Piece(GOP_TYPE, opacity), second])
    yield Fault("opacity-over-bound", over, "plane log_opacity spans 12 to 12.5")
    yield plane("deflate-predictor", b"\x02\x03\x00", "unknown predictor 2", codec=1)
    yield plane("deflate-too-short", b"\x00\x03\x00", "does not hold 12 bytes", codec=1)
    yield plane("deflate-empty", b"", "unknown predictor None", codec=1)
    yield plane("context-cut", b"\x00\x00\x24", "cut short", codec=4)
    yield plane("context-not-before", b"\x01\x00\x02\x00\x24\x00", "not before it", codec=4)
    yield plane("context-no-guide", b"\x10\x00\x24\x00", "no plane to be guided by", codec=4)
    yield plane("context-no-token", bytes.fromhex("0000240000000100 0000"), "none of", codec=4)
    yield plane("ranges-too-high", b"\x00\xff\xff\x03\x00\x00\x01\x00", "out of range", codec=5)
    yield plane("ranges-trailing", bytes(4) + b"\x00\x00\x01\x00\x00", "goes on", codec=5)
    yield from _refinement_faults()
    yield from _prediction_faults()
    yield from _plate_faults()
    yield Fault("settings-not-json", joined([head, first, Piece(b"sett", b"[")]), "JSON")
    yield from _order_faults()


def _order_faults() -> Iterator[Fault]:
    """Faults of chunks that are sound by themselves, and of what a file holds more than once."""
    good = make_file(make_payloads(2), auxiliary=((b"sett", b"{}"),))
    head, first, second, settings = pieces(good)[:4]

    def without_index(name: str, says: str, *chunks: Piece) -> Fault:
        return Fault(name, joined([head, *chunks], reindex=False), says)

    flipped = Piece(GOP_TYPE, _flip(first.payload, 0))
    walk = joined([head, first, second], reindex=False)
    yield Fault("walk-first-frame", _flip(walk, walk.index(first.payload)), "CRC mismatch")
    yield without_index("walk-descending", "first frame is 0, after 5", second, first)
    yield without_index("walk-twice", "first frame is 0, after 2", first, first, second)
    yield without_index("walk-lost", "frames 0 to 2 are lost", second)
    no_counts = patched(patched(good, HEAD_TYPE, 8, "I", 2), HEAD_TYPE, 58, "QI", 0, 0)
    growing = pieces(no_counts)[0]
    damaged = joined([growing, settings, first], reindex=False)
    damaged = _flip(damaged, damaged.index(settings.to_bytes()) + 16)
    yield Fault("stream-lost", joined([growing, second], reindex=False), "frames 0 to 2 are lost")
    yield Fault("stream-settings-damaged", damaged, "chunk sett")
    yield Fault("index-descending", joined([head, second, first]), "expected 0")
    yield Fault(
        "index-first-frame", joined([head, flipped, second]), "first frame is 1, expected 0"
    )
    summary = patched(good, INDEX_TYPE, 4 + 2 * 56 + 12, "B", 1)
    yield Fault("index-summary-of-settings", summary, "no valid index")
    chunk = b"x\0pr" + bytes(8)
    chunk += struct.pack("<II", zlib.crc32(chunk), zlib.crc32(b""))
    at = walk.index(second.to_bytes())
    yield Fault("type-without-letters", walk[:at] + chunk + walk[at:], "skipped 20 damaged bytes")
    yield Fault("settings-twice", joined([head, first, settings, settings]), "2 chunks sett")
    tags = Piece(b"meta", b"{}")
    yield Fault("tags-twice", joined([head, tags, first, tags]), "2 chunks meta")
    damaged = _flip(good, good.index(settings.to_bytes()) + 16)
    yield Fault("settings-damaged", damaged, "chunk sett")
    sound = Piece(b"strm", b"neither MP4 nor Matroska")
    yield Fault("sound-unknown", joined([head, first, sound]), "chunk strm")
    no_stream = Piece(b"meta", b'{"streams": [{"tags": {}, "disposition": 0}]}')
    yield Fault("tags-of-no-stream", joined([head, no_stream, first]), "tags of 1 streams")
    image = make_file([make_payload(20, pack="png")])
    yield Fault("image-in-plain", patched(image, HEAD_TYPE, 8, "I", 0), "has not their flag")
    payload = bytearray(first.payload)
    struct.pack_into("<q", payload, 24, 2**52)
    yield Fault("span", joined([head, Piece(GOP_TYPE, bytes(payload)), second]), "from timestamp 0")
    late = make_file([make_payload(5, start_pts=2**62 - 100)])
    yield Fault("last-tick", patched(late, GOP_TYPE, 24, "q", 2**62), "timestamps")


def _refinement_faults() -> Iterator[Fault]:
    """Faults behind the planes of the first GOP."""

    def behind(name: str, says: str, refinement: bytes, gaussians: int = 20) -> Fault:
        payload = make_payload(gaussians)
        return Fault(name, make_file([payload[:-TABLE_BYTES] + refinement]), says)

    none = bytes(TABLE_BYTES)
    every = struct.pack("<bB", -128, 1) + none[2:]  # a bit for both positions of each Gaussian
    yield behind("refinement-none", "refinement cut short", b"")
    yield behind("refinement-cut", "refinement cut short", none[1:])
    yield behind("refinement-most", "of position by 9 bits", b"\0\x09" + none[2:])
    yield behind("refinement-level", "of position by 0 bits from level 1", b"\1" + none[1:])
    yield behind("refinement-without-new", "without new Gaussians", every, gaussians=0)
    yield behind("refinement-trailing", "of 1 bytes for 0 bits", none + b"\0")
    yield behind("refinement-short", "of 4 bytes for 40 bits", every + bytes(4))
    yield behind("refinement-long", "of 6 bytes for 40 bits", every + bytes(6))
    yield behind("refinement-ones", "behind the last bit", every + bytes(4) + b"\1", gaussians=19)


def _prediction_faults() -> Iterator[Fault]:
    chain = make_chain((3, 3))
    good = make_file(chain)
    head, key, predicted = pieces(good)[:3]

    def in_second(name: str, offset: int, layout: str, *values: int, says: str) -> Fault:
        payload = bytearray(predicted.payload)
        struct.pack_into("<" + layout, payload, offset, *values)
        return Fault(name, joined([head, key, Piece(GOP_TYPE, bytes(payload))]), says)

    def constant(name: str, plane: int, data: bytes, says: str, **changes: int) -> Fault:
        payload = with_plane(predicted.payload, plane, data, codec=0, **changes)
        return Fault(name, joined([head, key, Piece(GOP_TYPE, payload)]), says)

    gaussians = parse_gop_head(predicted.payload).gaussians
    yield in_second("reference-before-start", 40, "I", 4, says="4 frames before frame 3")
    yield in_second("reference-inside-gop", 40, "I", 2, says="frame 1 is lost, which")
    yield in_second("reference-none", 40, "I", 0, says="key GOP that carries 30")
    yield Fault("reference-lost", joined([head, predicted], reindex=False), "0 is lost, which")
    damaged = _flip(good, good.index(key.payload) + 90)
    yield Fault("reference-damaged", damaged, "CRC mismatch")
    other = Piece(GOP_TYPE, make_payload(29, (3, 2, 4)))
    yield Fault("reference-of-others", joined([head, other, predicted]), "expects 30")
    yield Fault("key-gop-carries", patched(good, GOP_TYPE, 56, "I", 1), "key GOP that carries 1 ")
    yield in_second("dropped-too-many", 60, "I", 31, says="30 - 31 are carried over")
    yield in_second("changed-too-many", 64, "I", 25, says="25 changed and")
    yield in_second("moved-too-many", 68, "I", 2**32 - 1, says="4294967295 moved")
    payload = bytearray(predicted.payload)
    struct.pack_into("<I", payload, 12, gaussians - 1)
    struct.pack_into("<I", payload, 60, 7)
    counts = joined([head, key, Piece(GOP_TYPE, bytes(payload))])
    yield Fault("modes-of-others", counts, "the GOP's head says 7, 12 and 12")
    yield in_second("carried-over-maximum", 56, "II", 2**32 - 1, 2**32 - 25, says="maximum is")
    yield constant("mode-unknown", MODES, b"\5\0", "mode 5 of a Gaussian")
    half = step_number(0.5)
    says = "plane mode of 3 bits from 0 in steps of 0.5"
    yield constant("mode-step", MODES, b"\0\0", says, step=half)
    says = "plane log_opacity_change spans -24.5 to -24"
    over = {"bits": 1, "first": -49, "step": half}
    yield constant("opacity-change-over-bound", MODES + 9, b"\0\0", says, **over)


def _plate_faults() -> Iterator[Fault]:
    """Faults of a plate, and of what says that there is one."""
    times = np.array([0]), np.array([40])
    gop, coded = make_gop(4), a_plate(64, 48)

    def with_plate(name: str, says: str, plate: bytes) -> Fault:
        return Fault(name, make_file([pack_gop(gop, *times, 0, BITS, plate=plate)]), says)

    good = make_file([pack_gop(gop, *times, 0, BITS, plate=coded)])
    chain = make_file(make_chain((3, 3)), replace(HEADER, flags_required=PLATES_FLAG))
    head, key, predicted = pieces(chain)[:3]
    head = pieces(patched(chain, HEAD_TYPE, 4, "I", PLATES_FLAG))[0]
    payload = bytearray(predicted.payload)
    struct.pack_into("<H", payload, PLATE, 1)
    after = joined([head, key, Piece(GOP_TYPE, bytes(payload))])
    yield Fault("plate-of-predicted", after, "plate 1 of a predicted GOP")
    of_sum = make_file([make_payload(5, blending="sum")], replace(HEADER, blending="sum"))
    yield Fault("plates-of-sum", patched(of_sum, HEAD_TYPE, 4, "I", 1), "pictures are sums")
    yield Fault("plate-cut", patched(good, GOP_TYPE, TABLE_OFFSET, "I", 2**32 - 1), "are left")
    yield with_plate("plate-empty", "no AVIF picture", b"")
    yield with_plate("plate-damaged", "no AVIF picture", coded[:40] + bytes(len(coded) - 40))
    yield with_plate("plate-of-another-size", "pixels, not of the coded size", a_plate(48, 64))
    yield with_plate("plate-too-large", "no AVIF picture", a_plate(640, 480))
    grey = imagecodecs.avif_encode(np.zeros((48, 64, 3), np.uint8), level=60, pixelformat="420")
    yield with_plate("plate-subsampled", "expected 4:4:4", bytes(grey))


def _flip(data: bytes, offset: int) -> bytes:
    return data[:offset] + bytes([data[offset] ^ 1]) + data[offset + 1 :]
