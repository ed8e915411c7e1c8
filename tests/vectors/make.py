"""Writes the test vectors again: `python -m tests.vectors.make`.

Planes coded by PNG, JPEG XL or deflate may come out as other bytes with other versions of the
libraries; what they decode to may not change. Vectors are written again only when the format does.
"""

from __future__ import annotations

import hashlib
import io
import json
import struct
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields, replace
from fractions import Fraction
from pathlib import Path

import numpy as np

from gsvrcodec.bitstream.chunk import (
    END_TYPE,
    GOP_TYPE,
    HEAD_TYPE,
    INDEX_TYPE,
    SIGNATURE,
)
from gsvrcodec.bitstream.gop_chain import GopUnpacker
from gsvrcodec.bitstream.gop_head import GOP_HEAD_BYTES, SUMMARY_BYTES, parse_gop_head
from gsvrcodec.bitstream.gop_payload import pack_gop, unpack_gop
from gsvrcodec.bitstream.header import ColourInfo, Header
from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.bitstream.refinement_bits import TABLE_BYTES
from gsvrcodec.limits import Limits
from gsvrcodec.model.attributes import ATTRIBUTES
from gsvrcodec.model.gop import Gop
from gsvrcodec.model.prediction import Carried
from gsvrcodec.planes import PACKS
from tests.gops import (
    BITS,
    HEADER,
    REFINED,
    SIXTEEN_BITS,
    make_chain,
    make_file,
    make_gop,
    make_payload,
    make_payloads,
)
from tests.tampering import TABLE_OFFSET, Piece, edited, joined, patched, pieces, with_plane

HERE = Path(__file__).parent
VALID = HERE / "valid"
FAULTY = HERE / "faulty"


def minimal() -> bytes:
    """The file of the spec's worked example."""

    def values(*numbers: object) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
        return np.array(numbers, np.float32)

    none = np.zeros((0, 0, 8), np.float32)
    gop = Gop(
        position=values([0, 0]),
        log_scale=values([0.5, 0]),
        rotation=values(0.25),
        colour=values([0.5, 0.5, 0.5]),
        indicator=values(1),
        linear=values([0, 0]),
        quadratic=values([0, 0]),
        xy=none,
        xt=none,
        yt=none,
    )
    payload = pack_gop(gop, np.array([0]), np.array([1]), 0, BITS)
    return make_file([payload], Header(width=16, height=8, time_base=Fraction(1, 25)))


def variable_rate() -> bytes:
    """Three GOPs of uneven frames, the first before time 0, with auxiliary chunks among them."""
    steps = np.array([33, 33, 34, 100, 1, 5000, 33, 33])
    pts = np.cumsum(np.append(-1000, steps))
    parts = np.split(np.arange(len(pts)), [1, 4])
    payloads = [
        pack_gop(
            make_gop(7, (3, 2, 4), seed),
            pts[part],
            np.append(np.diff(pts[part]), 0),
            int(part[0]),
            BITS,
            PACKS["deflate"],
        )
        for seed, part in enumerate(parts)
    ]
    header = replace(
        HEADER,
        sample_aspect=Fraction(4, 3),
        rotation=90,
        bit_depth=10,
        colour=ColourInfo(1, 1, 1, True, 1),
        flags_optional=0x80000002,
    )
    settings = json.dumps({"profile": "main", "crop": None}).encode()
    chunks = pieces(make_file(payloads, header, ((b"sett", settings),)))
    chunks.insert(2, Piece(b"xprv", b"private"))
    return joined(chunks)


def newer_minor() -> bytes:
    """A later minor version, whose header and GOP head have grown."""

    def grow(payload: bytearray) -> None:
        payload[2:4] = b"\x63\x00"
        payload += b"new fields"

    def grow_gop(payload: bytearray) -> None:
        payload[SUMMARY_BYTES] += 6
        payload[GOP_HEAD_BYTES:GOP_HEAD_BYTES] = b"fields"

    return edited(edited(minimal(), HEAD_TYPE, grow), GOP_TYPE, grow_gop)


def valid_vectors() -> Iterator[tuple[str, bytes]]:
    """Names and bytes of all files that every decoder must read."""
    yield "minimal", minimal()
    yield "black", make_file([make_payload(0)])
    yield "black-triplane", make_file([make_payload(0, (2, 2, 2))])
    yield "variable-rate", variable_rate()
    yield "newer-minor", newer_minor()
    for pack in ("deflate", "png", "jxl", "entropy", "auto"):
        yield pack, make_file([make_payload(50, (6, 4, 3), pack=pack, seed=1)])
    yield "entropy-strips", make_file([make_payload(400, pack="entropy", seed=2)])
    yield "predicted", make_file(make_chain())
    yield "predicted-entropy", make_file(make_chain((2, 2, 2), 120, 20, pack="entropy"))
    yield "predicted-branches", make_file(make_chain((3, 1, 2, 2, 2), references=(0, 1, 0, 1)))
    yield "refined", make_file([make_payload(50, (6, 4, 3), pack="entropy", bits=REFINED, seed=1)])
    yield "predicted-refined", make_file(make_chain((2, 2, 2), bits=REFINED))
    for name, pack in (("sixteen-bits", "jxl"), ("sixteen-bits-entropy", "entropy")):
        yield name, make_file([make_payload(30, (4, 3, 2), pack=pack, bits=SIXTEEN_BITS)])


@dataclass(frozen=True)
class Fault:
    """A broken file and how a decoder must take it."""

    name: str
    data: bytes
    exit_code: int  #: of the error; 0 = it is recovered, with warnings
    says: str  #: part of the error or warning


def faulty_vectors() -> Iterator[Fault]:
    """All broken files, one fault each."""
    good = make_file(make_payloads(2), auxiliary=((b"sett", b"{}"),))
    chunks = pieces(good)
    head, first, second = chunks[0], chunks[1], chunks[2]
    gop = first.payload

    def header(name: str, offset: int, layout: str, *values: int, code: int, says: str) -> Fault:
        return Fault(name, patched(good, HEAD_TYPE, offset, layout, *values), code, says)

    def in_gop(name: str, offset: int, layout: str, *values: float, says: str) -> Fault:
        return Fault(name, patched(good, GOP_TYPE, offset, layout, *values), 3, says)

    def plane(name: str, data: bytes, says: str, **changes: float) -> Fault:
        payload = with_plane(gop, 0, data, **changes)
        return Fault(name, joined([head, Piece(GOP_TYPE, payload), second]), 3, says)

    yield Fault("empty", b"", 3, "empty")
    yield Fault("text", b"This is not a video.\n", 3, "not a .gsvr file")
    yield Fault("cut-signature", SIGNATURE[:5], 3, "ends inside the signature")
    yield Fault("crlf-to-lf", good.replace(b"\r\n", b"\n"), 3, "line ends")
    yield Fault("seven-bit", bytes(byte & 0x7F for byte in good), 3, "7-bit")
    yield Fault("no-header", joined(chunks[1:]), 3, "expected HEAD")
    yield Fault("second-header", joined([head, head, first]), 3, "second header")
    yield Fault("no-gop", joined([head]), 3, "no whole GOP")
    yield Fault("no-index", joined(chunks[:3], reindex=False), 0, "has no end")
    yield Fault("cut-gop", good[: good.index(second.to_bytes()) + 99], 0, "past the end")
    yield Fault("trailing-bytes", good + b"more", 0, "after the end of the file")
    yield Fault("flipped-payload", _flip(good, good.index(gop) + 70), 3, "CRC mismatch")
    yield Fault("flipped-chunk-head", _flip(good, good.index(gop) - 8), 3, "CRC mismatch")
    yield Fault("critical-chunk", joined([head, first, Piece(b"Nope", b"")]), 4, "chunk Nope")
    yield header("major-version", 0, "H", 1, code=4, says="version 1.6")
    yield header("version-0.5", 2, "H", 5, code=4, says="reads 0.6 and later: encode the")
    yield header("required-flag", 4, "I", 1 << 31 | 13, code=4, says="flags 0x80000000")
    yield header("no-prediction-flag", 4, "I", 1, code=3, says="flags 0x00000001")
    yield header("zero-width", 12, "I", 0, code=3, says="picture size 0x48")
    yield header("zero-time-base", 36, "I", 0, code=3, says="time base 0/1000")
    yield header("zero-aspect", 24, "I", 0, code=3, says="aspect ratio 1/0")
    yield header("rotation", 28, "H", 45, code=3, says="rotation 45")
    yield header("huge-picture", 12, "II", 32768, 32768, code=4, says="number of pixels")
    yield header("gaussians-over-maximum", 44, "I", 4, code=3, says="header's maximum is 4")
    yield header("frames-over-maximum", 48, "I", 2, code=3, says="header's maximum is 2")
    yield header("wrong-count", 58, "Q", 99, code=0, says="the header says 99 frames")
    yield Fault(
        "index-sizes-swapped",
        patched(good, INDEX_TYPE, 8, "Q", len(second.payload) + 1),
        0,
        "no valid index",
    )
    yield Fault("index-frame-gap", patched(good, INDEX_TYPE, 72, "Q", 4), 0, "expected 3")
    yield Fault("index-lies", patched(good, INDEX_TYPE, 28, "I", 1), 3, "the index names")
    yield Fault("end-lies", patched(good, END_TYPE, 0, "Q", 2**64 - 1), 0, "no valid index")
    yield Fault("zero-frames", patched(good, GOP_TYPE, 8, "I", 0), 0, "GOP of 0 frames")
    yield in_gop("zero-step", GOP_HEAD_BYTES + 1, "B", 0, says="step 0")
    yield in_gop("run-too-long", GOP_HEAD_BYTES, "B", 4, says="timing run of 4 frames")
    yield in_gop("half-triplane", SUMMARY_BYTES + 4, "H", 2, says="tri-plane of 2x0x0")
    yield in_gop("head-too-long", SUMMARY_BYTES, "H", 73, says="GOP head of 73 bytes")
    yield in_gop("head-too-short", SUMMARY_BYTES, "H", 71, says="GOP head of 71 bytes")
    yield in_gop("head-reserved", SUMMARY_BYTES + 10, "H", 1, says="reserved bytes")
    yield in_gop("plane-order", TABLE_OFFSET + 1, "B", 1, says="plane 0.1 where 0.0")
    yield in_gop("plane-bits", TABLE_OFFSET + 3, "B", 17, says="of 17 bits")
    yield in_gop("step-zero", TABLE_OFFSET + 8, "f", 0, says="step 0 is not constant")
    yield in_gop("step-negative", TABLE_OFFSET + 8, "f", -1, says="step -1")
    yield in_gop("step-nan", TABLE_OFFSET + 8, "f", np.nan, says="step nan")
    yield in_gop("offset-infinite", TABLE_OFFSET + 4, "f", np.inf, says="offset inf")
    yield in_gop("value-over-bound", TABLE_OFFSET + 8, "f", 1e30, says="allowed is -1024")
    yield in_gop("plane-size", TABLE_OFFSET + 12, "I", 2**32 - 1, says="planes end at byte")
    yield Fault(
        "unknown-codec", patched(good, GOP_TYPE, TABLE_OFFSET + 2, "B", 9), 4, "plane codec 9"
    )
    yield Fault(
        "unknown-attribute", patched(good, GOP_TYPE, TABLE_OFFSET, "B", 99), 4, "attribute 99"
    )
    yield plane("constant-too-large", b"\x10\x00", "sample 16", codec=0, bits=4)
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
    yield Fault("settings-not-json", joined([head, first, Piece(b"sett", b"[")]), 3, "JSON")


def _refinement_faults() -> Iterator[Fault]:
    """Faults behind the planes of the first GOP."""

    def behind(name: str, says: str, refinement: bytes, gaussians: int = 20) -> Fault:
        payload = make_payload(gaussians)
        return Fault(name, make_file([payload[:-TABLE_BYTES] + refinement]), 3, says)

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
    modes = 37  # the number of the plane `mode`: the GOP has new Gaussians and a tri-plane

    def in_second(name: str, offset: int, layout: str, *values: int, code: int, says: str) -> Fault:
        payload = bytearray(predicted.payload)
        struct.pack_into("<" + layout, payload, offset, *values)
        return Fault(name, joined([head, key, Piece(GOP_TYPE, bytes(payload))]), code, says)

    def mode(name: str, data: bytes, says: str, **changes: float) -> Fault:
        payload = with_plane(predicted.payload, modes, data, **changes)
        return Fault(name, joined([head, key, Piece(GOP_TYPE, payload)]), 3, says)

    gaussians = parse_gop_head(predicted.payload).gaussians
    yield in_second("reference-before-start", 40, "I", 4, code=0, says="4 frames before frame 3")
    yield in_second("reference-inside-gop", 40, "I", 2, code=3, says="frame 1 is lost, which")
    yield in_second("reference-none", 40, "I", 0, code=3, says="key GOP that carries 30")
    yield Fault("reference-lost", joined([head, predicted], reindex=False), 3, "0 is lost, which")
    damaged = _flip(good, good.index(key.payload) + 90)
    yield Fault("reference-damaged", damaged, 3, "CRC mismatch")
    other = Piece(GOP_TYPE, make_payload(29, (3, 2, 4)))
    yield Fault("reference-of-others", joined([head, other, predicted]), 3, "expects 30")
    yield Fault(
        "key-gop-carries", patched(good, GOP_TYPE, 56, "I", 1), 3, "key GOP that carries 1 "
    )
    yield in_second("dropped-too-many", 60, "I", 31, code=3, says="30 - 31 are carried over")
    yield in_second("changed-too-many", 64, "I", 25, code=3, says="25 changed and")
    yield in_second("moved-too-many", 68, "I", 2**32 - 1, code=3, says="4294967295 moved")
    payload = bytearray(predicted.payload)
    struct.pack_into("<I", payload, 12, gaussians - 1)
    struct.pack_into("<I", payload, 60, 7)
    counts = joined([head, key, Piece(GOP_TYPE, bytes(payload))])
    yield Fault("modes-of-others", counts, 3, "the GOP's head says 7, 12 and 12")
    yield in_second(
        "carried-over-maximum", 56, "II", 2**32 - 1, 2**32 - 25, code=3, says="maximum is"
    )
    yield mode("mode-unknown", b"\5\0", "mode 5 of a Gaussian", codec=0)
    yield mode(
        "mode-step", b"\0\0", "plane mode of 3 bits with offset 0 and step 0.5", codec=0, step=0.5
    )


def _flip(data: bytes, offset: int) -> bytes:
    return data[:offset] + bytes([data[offset] ^ 1]) + data[offset + 1 :]


def description(data: bytes) -> dict[str, object]:
    """What a decoder must find in a valid file: header, timing, and hashes of all coded values.

    Gaussians that are carried over are computed from others, and stand here as decimal numbers.
    """
    with GsvrReader(io.BytesIO(data), Limits()) as reader:
        header = asdict(reader.header)
        header["time_base"] = str(header["time_base"])
        header["sample_aspect"] = str(header["sample_aspect"])
        gops = []
        unpacker = GopUnpacker(reader, Limits())
        for position in range(len(reader.gops)):
            content = unpack_gop(reader.read_gop(position), reader.header, Limits())
            found: dict[str, object] = {
                "first_frame": content.first_frame,
                "reference": content.reference,
                "pts": content.pts.tolist(),
                "durations": content.durations.tolist(),
                "new": _exact(
                    {field.name: getattr(content.new, field.name) for field in fields(Gop)}
                ),
            }
            if content.carried is not None:
                carried = {
                    field.name: getattr(content.carried, field.name) for field in fields(Carried)
                }
                whole = unpacker.unpack(position).gop
                kept = len(whole) - len(content.new)
                found["carried"] = _exact(carried)
                found["carried_over"] = {
                    name: " ".join(f"{value:.6f}" for value in getattr(whole, name)[:kept].flat)
                    for name in ("position", "log_scale", "rotation", "colour")
                }
            gops.append(found)
        return {
            "header": header,
            "chunks": [[chunk.name, chunk.offset, chunk.size] for chunk in reader.chunks],
            "gops": gops,
        }


def _exact(values: dict[str, np.ndarray]) -> dict[str, object]:
    """Shapes and hashes of arrays."""
    return {
        "shapes": {name: list(array.shape) for name, array in values.items()},
        "sha256": {
            name: hashlib.sha256(array.astype(array.dtype.newbyteorder("<")).tobytes()).hexdigest()
            for name, array in values.items()
        },
    }


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
            (4, "version 0.6"),
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
        ],
    )
    timing = [(3, "timing: 1 frame, step 1, duration 1")]
    shape = [
        (4, "72 bytes, 13 planes"),
        (6, "Gx, Gy, Gt"),
        (2, "reserved"),
        (8, "carries 0, drops 0"),
        (8, "changes 0, moves 0"),
    ]
    table = [(16, f"plane {name}") for name in names]
    planes = [(2, f"samples of {name}") for name in names]
    refinement = [(12, "no refinement")]
    chunk("GOPD", [*summary, *shape, *timing, *table, *planes, *refinement])
    gop_size = GOP_HEAD_BYTES + 3 + 18 * len(names) + 12
    chunk("indx", [(4, "1 entry"), (4, "type GOPD"), (8, f"length {gop_size}"), *summary])
    chunk("fend", [(8, f"index at byte {98 + 20 + gop_size}"), (8, f"file of {len(data)} bytes")])
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


def main() -> None:
    """Write all vectors beside this script."""
    for name, data in valid_vectors():
        (VALID / f"{name}.gsvr").write_bytes(data)
        text = json.dumps(description(data), indent=1)
        (VALID / f"{name}.json").write_text(text + "\n")
    expected = {}
    for fault in faulty_vectors():
        (FAULTY / f"{fault.name}.gsvr").write_bytes(fault.data)
        expected[fault.name] = {"exit_code": fault.exit_code, "says": fault.says}
    (FAULTY / "expected.json").write_text(json.dumps(expected, indent=1) + "\n")


if __name__ == "__main__":
    main()
