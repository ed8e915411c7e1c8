"""A slow decoder of GSVR files, written from the text of the specification (1.0) alone."""

from __future__ import annotations

import hashlib
import io
import json
import math
import struct
import sys
import zlib
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

Ints = npt.NDArray[np.int64]
Floats = npt.NDArray[np.float32]
Doubles = npt.NDArray[np.float64]
Values = dict[str, npt.NDArray[Any]]

PLATES = 1  # a flag of the header that must be understood
IMAGE_CODECS, STREAM = 1, 2  # flags of the header that may be ignored
DROPPED = 4  # a mode of section 5.5
LIMIT_PIXELS, LIMIT_GAUSSIANS, LIMIT_FRAMES = 2**28, 2**24, 2**16  # section 12
LIMIT_CHAIN, LIMIT_PLANE_SAMPLES = 1024, 2**26
PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"


class Corrupt(Exception):
    """The file, or one GOP of it, breaks a rule."""


class Cut(Corrupt):
    """The file ends inside a chunk."""


class Unsupported(Exception):
    """The file needs a feature or a size that this decoder does not have."""


def require(condition: object, sentence: str) -> None:
    """Report a broken rule."""
    if not condition:
        raise Corrupt(sentence)


def limit(number: int, most: int, what: str) -> None:
    """Report a number over a limit."""
    if number > most:
        raise Unsupported(f"{what}: {number} is over the limit of {most}.")


def unzigzag(value: int) -> int:
    """Map 0, 1, 2, 3, 4 to 0, -1, 1, -2, 2 and so on."""
    return (value >> 1) ^ -(value & 1)


@dataclass
class Reader:
    """Reads numbers from the front of some bytes (section 1)."""

    data: bytes
    at: int = 0

    def take(self, count: int) -> bytes:
        """Return the next bytes."""
        require(self.at + count <= len(self.data), "The data ends too early.")
        self.at += count
        return self.data[self.at - count : self.at]

    def unpack(self, layout: str) -> tuple[Any, ...]:
        """Return the next little-endian numbers."""
        return struct.unpack("<" + layout, self.take(struct.calcsize("<" + layout)))

    def varint(self, bits: int = 63) -> int:
        """Return the next varint."""
        value = 0
        for group in range(9):
            byte = self.take(1)[0]
            value |= (byte & 127) << (7 * group)
            if byte < 128:
                require((byte or not group) and value < 2**bits, "A varint is too long or large.")
                return value
        raise Corrupt("A varint has over 9 bytes.")


def read_chunk(data: bytes, offset: int) -> tuple[bytes, bytes, bool]:
    """Check the head of a chunk; return its type, its payload, and whether the CRC is right."""
    where = f"The chunk at byte {offset}"
    if offset + 16 > len(data):
        raise Cut(f"{where} has no complete head.")
    kind, length, crc = struct.unpack_from("<4sQI", data, offset)
    require(kind.isalpha(), f"{where} has a type that is not four letters.")
    require(zlib.crc32(data[offset : offset + 12]) == crc, f"{where} has a damaged head.")
    end = offset + 16 + length
    if end + 4 > len(data):
        raise Cut(f"{where} reaches past the end of the file.")
    payload = data[offset + 16 : end]
    return kind, payload, zlib.crc32(payload) == int.from_bytes(data[end : end + 4], "little")


class Header(NamedTuple):
    """What pictures depend on of the header chunk (section 4)."""

    minor: int  # version
    flags: int  # that may be ignored
    width: int  # of the coded frame, pixels
    height: int
    most: tuple[float, ...]  # Gaussians, frames, Gx, Gy, Gt of a GOP; infinite = not known
    mean: bool  # pictures are weighted means, not sums
    plates: bool  # GOPs may hold plates


def read_header(data: bytes) -> tuple[Header, int]:
    """Take steps 1 to 3 of section 11; return the header and the offset of its end."""
    require(data[:8] == b"\x89GSV\r\n\x1a\n", "The signature is not that of GSVR.")
    kind, payload, sound = read_chunk(data, 8)
    sound &= kind == b"HEAD" and 4 <= len(payload) <= 4096
    require(sound, "The first chunk is no header, or has a wrong length or CRC.")
    reader = Reader(payload)
    major, minor = reader.unpack("2H")
    if major != 1:
        raise Unsupported(f"The file has version {major}.{minor}, this decoder knows 1.0.")
    if (minor, len(payload)) in [(0, 70), (0, 72)]:
        raise Unsupported("The file is of an earlier release candidate of version 1.0.")
    require(len(payload) == 71 or (minor and len(payload) > 71), "The header has a wrong length.")
    must, may = reader.unpack("2I")
    blending = payload[70]
    if must & ~PLATES or blending > 1:
        raise Unsupported(f"The header has unknown flags {must:#x} or blending {blending}.")
    require(blending or not must, "A file of sums has the flag of plates.")
    width, height, *aspect = reader.unpack("4I")
    rotation, depth, *colour = reader.unpack("H6B")
    time_base, maxima = reader.unpack("2I"), reader.unpack("2I3H")
    require(all([width, height, *aspect, *time_base]), "A size, sample aspect or time base is 0.")
    known = rotation & 32767 in (0, 90, 180, 270) and 1 <= depth <= 16
    known &= colour[3] <= 1 and colour[4] <= 6
    require(known, "A rotation, depth, range or chroma location is not known.")
    limit(width * height, LIMIT_PIXELS, "Pixels")
    unknown = (2**32 - 1,) * 2 + (2**16 - 1,) * 3
    most = tuple(math.inf if a == b else a for a, b in zip(maxima, unknown, strict=True))
    limit(maxima[0] if most[0] < math.inf else 0, LIMIT_GAUSSIANS, "Gaussians in a GOP")
    limit(maxima[1] if most[1] < math.inf else 0, LIMIT_FRAMES, "Frames in a GOP")
    mean, plates = blending == 1, must == PLATES
    return Header(minor, may, width, height, most, mean, plates), 28 + len(payload)


class GopChunk(NamedTuple):
    """The place of a GOP in the file, and its summary (section 5.1) in the order of the file."""

    offset: int
    length: int
    first_frame: int
    frames: int
    gaussians: int
    first_pts: int
    last_pts: int
    last_duration: int
    reference: int


def read_summary(offset: int, length: int, data: bytes, last: GopChunk | None = None) -> GopChunk:
    """Read a summary; check it, and that it comes after the last GOP."""
    gop = GopChunk(offset, length, *Reader(data).unpack("Q2I2qQI"))
    require(gop.frames and gop.first_frame + gop.frames <= 2**62, "A GOP has wrong frame numbers.")
    span = gop.last_pts - gop.first_pts
    inside = -(2**62) < gop.first_pts <= gop.last_pts < 2**62 and gop.last_duration < 2**62
    require(inside and span < 2**52 and (span == 0) == (gop.frames == 1), "A GOP has wrong times.")
    if last:
        later = gop.first_frame >= last.first_frame + last.frames and gop.first_pts > last.last_pts
        require(later, "A GOP does not come after the last one.")
    return gop


def read_index(data: bytes, first: int) -> tuple[list[GopChunk], list[bytes]]:
    """Return the GOPs and the types of all chunks; Corrupt if the index is not valid."""
    end = len(data) - 36
    kind, payload, sound = read_chunk(data, end)
    require((kind, len(payload), sound) == (b"fend", 16, True), "There is no end chunk.")
    offset, size = struct.unpack("<2Q", payload)
    require(size == len(data) and first <= offset < end, "The end chunk is not of this file.")
    kind, payload, sound = read_chunk(data, offset)
    sound &= kind == b"indx" and offset + 20 + len(payload) == end
    require(sound, "There is no index before the end chunk, or its CRC is wrong.")
    reader = Reader(payload)
    (count,) = reader.unpack("I")
    require(len(payload) == 4 + 56 * count, "The index has another length than its entries.")
    gops, kinds, starts = list[GopChunk](), list[bytes](), set[int]()
    at, frames = first, 0
    for _ in range(count):
        kind, length, summary = reader.unpack("4sQ44s")
        good = kind.isalpha() and kind not in (b"HEAD", b"indx", b"fend")
        require(good, f"The index lists a chunk {kind!r}.")
        require(kind == b"GOPD" or not any(summary), "A chunk that is no GOP has a summary.")
        if kind == b"GOPD":
            gop = read_summary(at, length, summary, *gops[-1:])
            found = gop.reference == 0 or gop.first_frame - gop.reference in starts
            require(gop.first_frame == frames and found, "The index misses frames or a reference.")
            starts.add(gop.first_frame)
            frames += gop.frames
            gops.append(gop)
        kinds.append(kind)
        at += length + 20
    require(at == offset, "The chunks of the index do not end where it starts.")
    return gops, kinds


def walk(data: bytes, first: int) -> tuple[list[GopChunk], list[bytes], list[str]]:
    """Go from chunk to chunk; return the GOPs, the types of all chunks, and what is wrong."""
    gops, kinds, faults = list[GopChunk](), list[bytes](), list[str]()
    offset = first
    while offset < len(data) and kinds[-1:] != [b"fend"]:
        try:
            kind, payload, sound = read_chunk(data, offset)
        except Corrupt as fault:
            found = data.find(b"GOPD", offset + 1)
            if found >= 0 or not isinstance(fault, Cut):
                faults.append(str(fault))
            offset = found if found >= 0 else len(data)
            continue
        kinds.append(kind)
        try:
            if kind == b"GOPD":
                require(sound, f"The GOP at byte {offset} has a wrong CRC.")
                end = gops[-1].first_frame + gops[-1].frames if gops else 0
                gops.append(read_summary(offset, len(payload), payload[:44], *gops[-1:]))
                require(gops[-1].first_frame == end, f"Frames are missing from frame {end} on.")
        except Corrupt as fault:
            faults.append(str(fault))
        offset += len(payload) + 20
    return gops, kinds, faults


class Attribute(NamedTuple):
    """A row of the table of section 5.4."""

    name: str
    components: int
    grid: str
    low: float
    high: float


MOST_LOG_OPACITY = 12
ATTRIBUTES = [
    Attribute("position", 2, "new", -1024, 1024),
    Attribute("log_scale", 2, "new", -32, 13),
    Attribute("rotation", 1, "new", -64, 64),
    Attribute("colour", 3, "new", -65536, 65536),
    Attribute("log_opacity", 1, "new", -MOST_LOG_OPACITY, MOST_LOG_OPACITY),
    Attribute("indicator", 1, "new", -2, 2),
    Attribute("linear", 2, "new", -1024, 1024),
    Attribute("quadratic", 2, "new", -1024, 1024),
    *(Attribute(name, 8, name, -1024, 1024) for name in ("xy", "xt", "yt")),
    Attribute("mode", 1, "reference", 0, 7),
    Attribute("position_change", 2, "changed", -1024, 1024),
    Attribute("log_scale_change", 2, "changed", -45, 45),
    Attribute("rotation_change", 1, "changed", -64, 64),
    Attribute("colour_change", 3, "changed", -65536, 65536),
    Attribute("log_opacity_change", 1, "changed", -24, 24),
    Attribute("carried_indicator", 1, "moved", -2, 2),
    *(Attribute(f"carried_{a}", 2, "moved", -1024, 1024) for a in ("linear", "quadratic")),
]
NEW = {a.name: a for a in ATTRIBUTES if a.grid == "new"}
REFINED = [name for name in NEW if name not in ("indicator", "log_opacity")]
LOOK = ("position", "log_scale", "rotation", "colour", "log_opacity")


class Entry(NamedTuple):
    """An entry of the plane table."""

    codec: int
    bits: int
    offset: float
    step: float
    length: int


@dataclass
class Plane:
    """An entry of the plane table, and what its codec needs."""

    attribute: Attribute
    component: int
    codec: int
    bits: int
    offset: float
    step: float
    length: int
    width: int
    height: int
    priors: list[Ints]  # samples of the planes of the same grid before this one
    samples: Ints = field(default_factory=lambda: np.zeros((0, 0), np.int64))


@dataclass
class Gop:
    """A decoded GOP, without the Gaussians that it carries over."""

    chunk: GopChunk
    reference_gaussians: int
    pts: list[int]  # of each frame, ticks
    durations: list[int]  # of each frame, ticks; 0 = not known
    # Of each attribute in the plane table: [n, components], [rows, columns, 6 or 8]. And "plate",
    # if the GOP stores one: Y, Cb and Cr, [Hc, Wc, 3].
    values: Values
    modes: npt.NDArray[np.uint8]  # of each Gaussian of the reference

    def tau(self, time: Fraction) -> float:
        """Return the normalised time of section 8.1."""
        span = self.pts[-1] - self.pts[0]
        return float(np.float32((2 * float(time - self.pts[0]) - span) / span)) if span else 0.0


def read_gop(payload: bytes, chunk: GopChunk, header: Header) -> Gop:
    """Decode a GOP in the order of section 11, but for its reference."""
    reader = Reader(payload)
    require(reader.unpack("Q2I2qQI") == chunk[2:], "The summary is not that of the index.")
    length, plane_count, *grid, plate = reader.unpack("6H")
    source, dropped, changed, moved = reader.unpack("4I")
    require(length == 72 or (header.minor and length > 72), f"The head has {length} bytes.")
    require(any(grid) == all(grid), "The tri-plane has sides that are zero.")
    require(plate <= (header.plates and not chunk.reference), "The field of the plate is wrong.")
    carried = source - dropped
    fit = (source == 0 or chunk.reference) and max(changed, moved) <= carried <= chunk.gaussians
    require(fit, "The counts of Gaussians do not fit together.")
    for number, most in zip((chunk.gaussians, chunk.frames, *grid), header.most, strict=True):
        require(number <= most, "The GOP exceeds a maximum of the header.")
    require(source <= header.most[0], "The reference exceeds a maximum of the header.")
    limit(max(chunk.gaussians, source), LIMIT_GAUSSIANS, "Gaussians in a GOP")
    limit(chunk.frames, LIMIT_FRAMES, "Frames in a GOP")
    reader.take(length - 72)
    pts, durations = read_timing(reader, chunk)
    avif = reader.take(reader.unpack("I")[0]) if plate else None
    counts = {"new": chunk.gaussians - carried, "reference": source}
    counts |= {"changed": changed, "moved": moved}
    entries = [read_entry(reader) for _ in range(plane_count)]
    planes = read_table(entries, grid, counts, header.mean)
    require(sum(p.length for p in planes) <= len(payload) - reader.at, "Planes are too long.")
    plain = not header.flags & IMAGE_CODECS
    require(not plain or all(p.codec not in (2, 3) for p in planes), "A plain file has an image.")
    sizes = [plane.width * plane.height for plane in planes]
    limit(4 * sum(sizes), 2**26 + 4096 * len(payload), "Bytes of all planes")
    limit(max(sizes, default=0), LIMIT_PLANE_SAMPLES, "Samples of a plane")
    for plane in planes:
        coded = Reader(reader.take(plane.length))
        try:
            plane.samples = CODECS[plane.codec](coded, plane)
            require(plane.samples.max() < 2**plane.bits, "A sample is too large.")
        except (Corrupt, zlib.error, RuntimeError) as fault:  # the last: of imagecodecs
            raise Corrupt(f"Plane {plane.attribute.name}.{plane.component}: {fault}") from fault
        plane.priors.append(plane.samples)
    values = dequantise(planes, counts)
    refine(payload[reader.at :], planes, counts["new"], values)
    modes: npt.NDArray[np.uint8] = values.get("mode", np.zeros(0)).astype(np.uint8).ravel()
    found = [np.count_nonzero(modes & bit) for bit in (4, 2, 1)]
    require(not (modes > DROPPED).any(), "A mode is not known.")
    require(found == [dropped, changed, moved], "The modes have other counts than the head says.")
    if source:
        values["mode"] = modes
    if avif is not None:
        values["plate"] = decode_plate(avif, header)
    return Gop(chunk, source, pts, durations, values, modes)


def read_timing(reader: Reader, chunk: GopChunk) -> tuple[list[int], list[int]]:
    """Read the timestamps and durations of section 5.2."""
    pts, durations, time = list[int](), list[int](), chunk.first_pts
    while len(pts) < chunk.frames:
        count, step, duration = reader.varint(), reader.varint(), reader.varint()
        require(1 <= count <= chunk.frames - len(pts), "A run of frames has a wrong length.")
        require(1 <= step < 2**62 and duration < 2**62, "A run of frames has wrong times.")
        pts += [time + step * i for i in range(count)]
        durations += [duration] * count
        time += step * count
    same = (pts[-1], durations[-1]) == (chunk.last_pts, chunk.last_duration)
    require(same and time < 2**63, "The timing does not end as the head says.")
    return pts, durations


def decode_plate(data: bytes, header: Header) -> npt.NDArray[np.uint8]:
    """Return Y, Cb and Cr of the plate of section 5.7, [Hc, Wc, 3]."""
    import av

    pixels = header.width * header.height
    limit(3 * pixels, 2**26 + 4096 * len(data), "Bytes of a plate")
    most = {"max_pixels": str(pixels)}
    try:
        # The name of the format keeps others away; the options are for what finds the streams.
        with av.open(io.BytesIO(data), "r", format="mov", options=most) as container:
            stream = container.streams.video[0]
            require(stream.codec_context.codec.canonical_name == "av1", "The plate is not AV1.")
            stream.codec_context.options = most
            frame = next(container.decode(stream))
    except (av.error.FFmpegError, UnicodeDecodeError, IndexError, StopIteration) as fault:
        raise Corrupt(f"The plate is no AVIF picture that can be decoded: {fault}") from fault
    sides = (frame.width, frame.height)
    require(sides == (header.width, header.height), f"The plate has {sides} pixels.")
    good = frame.format.name in ("yuv444p", "yuvj444p") and frame.color_range == 2
    require(good, f"The plate is {frame.format.name} of range {frame.color_range}.")
    return np.moveaxis(frame.to_ndarray().astype(np.uint8), 0, -1)


def read_entry(reader: Reader) -> Entry:
    """Read an entry of the plane table of section 5.3."""
    how, step = reader.unpack("BH")
    k, length = unzigzag(reader.varint(32)), reader.varint(32)
    step = (256 + step % 256) * 2.0 ** (step // 256 - 136)
    return Entry(how % 16, how // 16 + 1, k * step, step, length)


def read_table(entries: list[Entry], grid: list[int], n: dict[str, int], mean: bool) -> list[Plane]:
    """Give the entries of the plane table their attributes and check the rules of section 5.3."""
    for entry in entries:
        if entry.codec >= len(CODECS):
            raise Unsupported(f"The GOP has an unknown codec {entry.codec}.")
    gx, gy, gt = grid
    sizes = {"xy": (gx, gy), "xt": (gx, gt), "yt": (gy, gt)}
    for name, k in n.items():
        width = math.isqrt(k - 1) + 1 if k else 0
        sizes[name] = (width, -(-k // max(width, 1)))
    # Sums have no opacities, and the tri-planes of means have six channels.
    had = [a for a in ATTRIBUTES if sizes[a.grid][0] and (mean or "opacity" not in a.name)]
    most = 6 if mean else 8
    expected = [(a, component) for a in had for component in range(min(a.components, most))]
    require(len(entries) == len(expected), "The table has not the planes that it must have.")
    priors: dict[str, list[Ints]] = {name: [] for name in sizes}
    planes = []
    for (a, component), entry in zip(expected, entries, strict=True):
        o, last = entry.offset, entry.offset + (2**entry.bits - 1) * entry.step
        require(a.low <= o and last <= a.high, f"The plane {a.name} is out of bounds.")
        small = (entry.bits, o, entry.step) == (3, 0, 1)
        require(a.name != "mode" or small, "The plane mode is not of 3 bits.")
        size, prior = sizes[a.grid], priors[a.grid]
        planes.append(Plane(a, component, *entry, *size, prior))
    return planes


def dequantise(planes: list[Plane], counts: dict[str, int]) -> Values:
    """Return the values of all attributes without refinement and padding (section 7)."""
    parts: dict[str, list[Floats]] = {}
    for plane in planes:
        value = (plane.offset + plane.samples * plane.step).astype(np.float32)
        if plane.attribute.grid in counts:
            value = value.ravel()[: counts[plane.attribute.grid]]
        parts.setdefault(plane.attribute.name, []).append(value)
    return {name: np.stack(components, axis=-1) for name, components in parts.items()}


def refine(data: bytes, planes: list[Plane], new: int, values: Values) -> None:
    """Read the refinement of section 5.6 and put the refined values into `values`."""
    reader = Reader(data)
    table = {name: reader.unpack("bB") for name in REFINED}
    for name, (least, most) in table.items():
        good = (new and 0 < most <= 8) or most == least == 0
        require(good, f"The refinement of {name} has {most} bits from level {least} on.")
    coded = data[reader.at :]
    counts = bit_counts(table, values) if new else {}
    total = sum(NEW[name].components * int(k.sum()) for name, k in counts.items())
    require(len(coded) == (total + 7) // 8, "The refinement has another number of bytes.")
    bits = np.append(np.unpackbits(np.frombuffer(coded, np.uint8)), 0).astype(np.int64)
    require(not bits[total:].any(), "The refinement does not end with zeros.")
    start = 0
    for plane in [plane for plane in planes if plane.attribute.name in counts]:
        k = counts[plane.attribute.name]
        begin = start + np.cumsum(k) - k
        start += int(k.sum())
        r = np.zeros_like(k)
        for i in range(int(k.max())):
            r = np.where(i < k, 2 * r + bits[np.minimum(begin + i, total)], r)
        numerator = plane.samples.ravel()[:new] * 2 ** (k + 1) + 2 * r + 1 - 2**k
        value = plane.offset + numerator * (plane.step / 2.0 ** (k + 1))
        refined = clamp(plane.attribute.name, value)
        values[plane.attribute.name][:, plane.component] = refined


def bit_counts(table: dict[str, tuple[int, ...]], values: Values) -> dict[str, Ints]:
    """Return the number of bits k of each new Gaussian for each refined attribute."""
    l0, l1 = values["log_scale"].astype(np.float64).T
    o = values.get("log_opacity", np.zeros((len(l0), 1))).astype(np.float64)[:, 0]
    logarithms = np.array([l0 + l1, abs(l0 - l1), o])
    area, shape, opacity = np.floor(logarithms * 1.4426950408889634).astype(np.int64)
    level = {
        "position": (3 * shape + 2 * opacity - area) // 8,
        "log_scale": (2 * area + 3 * opacity) // 8,
        "rotation": (2 * area + 8 * shape + 3 * opacity) // 8,
        "colour": 3 * (area + opacity) // 8,
    }
    level["linear"] = level["quadratic"] = level["position"]
    motion = np.concatenate([values["linear"], values["quadratic"]], axis=1).any(axis=1)
    counts = {name: (level[name] - least).clip(0, most) for name, (least, most) in table.items()}
    for name in ("linear", "quadratic"):
        counts[name][(values["indicator"][:, 0] == 1) & ~motion] = 0
    return counts


def clamp(name: str, values: Doubles) -> Floats:
    """Round values to binary32 and clamp them to the bounds of their attribute."""
    low, high = np.float32(NEW[name].low), np.float32(NEW[name].high)
    return values.astype(np.float32).clip(low, high)


def decode_constant(reader: Reader, plane: Plane) -> Ints:
    """Codec 0."""
    require(len(reader.data) == 2, "A constant does not have 2 bytes.")
    return np.full((plane.height, plane.width), reader.unpack("H")[0], np.int64)


def inflate(data: bytes, window: int, size: int) -> bytes:
    """Inflate a whole stream to exactly `size` bytes."""
    inflater = zlib.decompressobj(window)
    result = inflater.decompress(data, size + 1)
    whole = inflater.eof and not inflater.unused_data
    require(whole and len(result) == size, f"The stream does not inflate to {size} bytes.")
    return result


def decode_deflate(reader: Reader, plane: Plane) -> Ints:
    """Codec 1."""
    predictor = reader.take(1)[0]
    require(predictor <= 1, f"The predictor {predictor} is not known.")
    shape = (1 if plane.bits <= 8 else 2, plane.height, plane.width)
    raw = inflate(reader.data[1:], -15, math.prod(shape))
    halves = np.frombuffer(raw, np.uint8).astype(np.int64).reshape(shape)
    values: Ints = halves[0] + 256 * halves[1] if plane.bits > 8 else halves[0]
    require(values.max() < 2**plane.bits, "A value is too large.")
    if predictor == 1:
        difference = (values >> 1) ^ -(values & 1)
        difference[:, 0] = difference[:, 0].cumsum()
        values = difference.cumsum(axis=1) % 2**plane.bits
    return values


def png_chunk(kind: bytes, body: bytes) -> bytes:
    """Return a chunk of a PNG file."""
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


def decode_png(reader: Reader, plane: Plane) -> Ints:
    """Codec 2."""
    size = 1 if plane.bits <= 8 else 2
    header = struct.pack(">2I5B", plane.width, plane.height, 8 * size, 0, 0, 0, 0)
    start = PNG_SIGNATURE + png_chunk(b"IHDR", header)
    require(reader.take(len(start)) == start, "The PNG header is not that of the plane.")
    kind, body, stream = b"IDAT", b"", b""
    while kind == b"IDAT":
        stream += body
        length, kind = struct.unpack(">I4s", reader.take(8))
        body = reader.take(length)
        require(reader.take(4) == png_chunk(kind, body)[-4:], "A PNG chunk has a wrong CRC.")
    end = (kind, body, reader.data[reader.at :])
    require(end == (b"IEND", b"", b""), "The PNG file does not end with IDAT and IEND.")
    stride = 1 + plane.width * size
    raw = inflate(stream, 15, plane.height * stride)
    row, rows = bytearray(size + stride - 1), bytearray()
    for at in range(0, len(raw), stride):
        require(raw[at] <= 4, "A PNG filter is not known.")
        row = unfilter(raw[at], bytearray(size) + raw[at + 1 : at + stride], row, size)
        rows += row[size:]
    return np.frombuffer(rows, f">u{size}").astype(np.int64).reshape(plane.height, plane.width)


def unfilter(kind: int, row: bytearray, above: bytearray, size: int) -> bytearray:
    """Undo a PNG filter of a row that starts with `size` zeros."""
    for i in range(size, len(row)):
        left, up, corner = row[i - size], above[i], above[i - size]
        distances = [abs(up - corner), abs(left - corner), abs(left + up - 2 * corner)]
        paeth = (left, up, corner)[distances.index(min(distances))]
        row[i] = (row[i] + (0, left, up, (left + up) // 2, paeth)[kind]) & 255
    return row


JXL_SIDE = ((1, 9), (1, 13), (1, 18), (1, 30))
JXL_RATIOS = ((0, 1), (1, 1), (12, 10), (4, 3), (3, 2), (16, 9), (5, 4), (2, 1))


@dataclass
class JxlBits:
    """Reads numbers of a JPEG XL codestream, the lowest bits first."""

    number: int
    at: int = 0

    def u(self, count: int) -> int:
        """Return a number of `count` bits."""
        self.at += count
        return self.number >> (self.at - count) & ((1 << count) - 1)

    def u32(self, kinds: tuple[tuple[int, int], ...]) -> int:
        """Return a number of one of four kinds, each a base and a count of bits."""
        base, count = kinds[self.u(2)]
        return base + self.u(count)


def decode_jxl(reader: Reader, plane: Plane) -> Ints:
    """Codec 3, with checks of the fields up to the colour space."""
    size = 1 if plane.bits <= 8 else 2
    bits = JxlBits(int.from_bytes(reader.data, "little"))
    require(bits.u(16) == 0x0AFF, "The plane is no JPEG XL codestream.")
    small = bits.u(1)
    height = 8 * bits.u(5) + 8 if small else bits.u32(JXL_SIDE)
    over, under = JXL_RATIOS[bits.u(3)]
    width = height * over // under
    if over == 0:
        width = 8 * bits.u(5) + 8 if small else bits.u32(JXL_SIDE)
    require((width, height) == (plane.width, plane.height), "The JPEG XL size is wrong.")
    require(bits.u(3) == 0, "JPEG XL: all_default, extra_fields or floats.")
    depth = bits.u32(((8, 0), (10, 0), (12, 0), (1, 6)))
    require(depth == 8 * size, "The JPEG XL bit depth is wrong.")
    bits.u(1)  # 16-bit buffers
    require(bits.u(5) == 0 and bits.u(2) == 1, "JPEG XL: extra channels, xyb_encoded or not grey.")
    import imagecodecs  # not before the checks

    image = np.asarray(imagecodecs.jpegxl_decode(reader.data))
    require((image.size, image.itemsize) == (width * height, size), "The JPEG XL image is wrong.")
    return image.astype(np.int64).reshape(height, width)


class RangeCoder:
    """The range coder of codecs 4 and 5: words from the front, bits from the end."""

    def __init__(self, reader: Reader) -> None:
        self.reader = reader
        self.state: int = reader.unpack("I")[0]
        require(self.state >= 2**16, "The initial state is too small.")
        self.bits_read = 0

    def advance(self, k: int, start: int, frequency: int) -> None:
        """Remove a symbol from the state."""
        self.state = frequency * (self.state >> k) + self.state % 2**k - start
        if self.state < 2**16:
            self.state = self.state << 16 | self.reader.unpack("H")[0]

    def bits(self, count: int) -> int:
        """Return a number of `count` bits."""
        value = 0
        for i in range(self.bits_read, self.bits_read + count):
            require(i < 8 * len(self.reader.data), "The bits end too early.")
            value = 2 * value + (self.reader.data[-1 - i // 8] >> (7 - i % 8) & 1)
        self.bits_read += count
        return value

    def finish(self) -> None:
        """Check the end of the plane."""
        require(self.state == 2**16, "The final state is not 2^16.")
        require(self.bits(-self.bits_read % 8) == 0, "There are bits left over.")
        used = self.reader.at + self.bits_read // 8
        require(used == len(self.reader.data), "Words and bits overlap, or leave a gap.")


class Context:
    """The tokens of one context of codec 4."""

    def __init__(self, coder: RangeCoder) -> None:
        level = [0] * 256
        for t in range(coder.bits(8) + 1):
            high = 0
            while coder.bits(1):
                high += 1
            level[t] = (level[t - 2] if t >= 2 else 0) + unzigzag(2 * high + coder.bits(1))
            require(0 <= level[t] <= 49, "A level of a token is out of bounds.")
        used = sum(n > 0 for n in level)
        require(used > 0, "A context has no tokens.")
        weight = [(4 + (n - 2) % 4) << ((n - 2) // 4) if n >= 2 else 0 for n in level]
        total = max(sum(weight), 1)
        f = [1 + weight[t] * (4096 - used) // total if level[t] else 0 for t in range(256)]
        f[level.index(max(level))] += 4096 - sum(f)
        self.frequency = f
        self.start = [sum(f[:t]) for t in range(256)]
        self.token = [t for t in range(256) for _ in range(f[t])]  # of each of the 4096 slots

    def number(self, coder: RangeCoder, direct: int, top: int) -> int:
        """Read a token and the plain bits that belong to it."""
        t = self.token[coder.state % 2**12]
        coder.advance(12, self.start[t], self.frequency[t])
        if t < 1 << direct:
            return t
        octave, part = divmod(t - (1 << direct), 2 << top)
        plain = octave + direct - top - 1
        require(plain <= 16, "A token is too large.")
        return ((1 << top) + part // 2 << plain | coder.bits(plain)) << 1 | part & 1


def decode_context(reader: Reader, plane: Plane) -> Ints:
    """Codec 4."""
    flags = reader.take(1)[0]
    guided = bool(flags & 16)
    may = not guided or (plane.attribute.grid == "new" and plane.priors)
    require(may and flags < 64, "The head has unknown flags, or the plane no guide.")
    c_plane = np.zeros((plane.height, plane.width), np.int64)
    last, magnitude = -1, 0
    for _ in range(flags & 15):
        number, weight = reader.take(1)[0], unzigzag(reader.varint(32))
        magnitude += abs(weight)
        good = last < number < len(plane.priors) and weight != 0 and magnitude <= 2**12
        require(good, "A prior plane has a wrong number or weight.")
        c_plane += weight * plane.priors[number]
        last = number
    bias = unzigzag(reader.varint(32))
    require(abs(bias) < 2**29, "The bias is too large.")
    c = (c_plane + bias).tolist()
    weights = reader.unpack("6b") if flags & 32 else (0,) * 6
    tokens, count = reader.unpack("2B")
    direct, top = tokens & 15, tokens >> 4
    require(top <= 2 and top < direct <= 7 and count <= 7, "The head has wrong tokens or contexts.")
    steps = [reader.varint(32) for _ in range(count)]
    require(all(steps) and sum(steps) <= 2**20, "A threshold is out of bounds.")
    thresholds = [sum(steps[: i + 1]) for i in range(count)]
    coder = RangeCoder(reader)
    contexts = [Context(coder) for _ in range(count + 1)]
    width, height, most = plane.width, plane.height, 2**plane.bits - 1
    guide = plane.priors[0].tolist() if guided else []
    samples = np.zeros((height, width), np.int64)
    d, e = [0] * (width * height + 1), [0] * (width * height + 1)  # the last: no neighbour
    for y in range(height):
        m = 0
        for x in range(width):
            if guided and y > 0:
                while m + 1 < width and guide[y - 1][m + 1] <= guide[y][x]:
                    m += 1
            else:
                m = x
            near = neighbours(x, y, m, width)
            pull = sum(v * d[i] for v, i in zip(weights, near, strict=True)) >> 6
            p = min(max((c[y][x] + pull + 128) >> 8, 0), most)
            around = sum(r * abs(e[i]) for r, i in zip((2, 1, 2, 2, 1, 1), near, strict=True))
            context = contexts[sum(around >= threshold for threshold in thresholds)]
            error = unzigzag(context.number(coder, direct, top))
            require(0 <= p + error <= most, "A sample is out of bounds.")
            samples[y, x] = p + error
            e[y * width + x] = error
            d[y * width + x] = 256 * (p + error) - c[y][x]
    coder.finish()
    return samples


def neighbours(x: int, y: int, m: int, width: int) -> list[int]:
    """Return the places of the six neighbours of codec 4; -1 is none."""
    here, above = y * width + x, (y - 1) * width
    left = here - 1 if x > 0 else here - width if y > 0 else -1
    left2 = here - 2 if x > 1 else left
    if y == 0:
        return [left, left2, left, left, left, left]
    return [left, left2, *(above + min(max(m + i, 0), width - 1) for i in (0, 1, -1, 2))]


def decode_ranges(reader: Reader, plane: Plane) -> Ints:
    """Codec 5."""
    ranges, highest = list[tuple[int, int]](), 0
    for _ in range(plane.height):
        lowest = highest + unzigzag(reader.varint(32))
        highest = lowest + reader.varint(32)
        require(lowest >= 0 and highest < 2**plane.bits, "A range is out of bounds.")
        ranges.append((lowest, highest - lowest + 1))
    coder = RangeCoder(reader)
    samples = np.zeros((plane.height, plane.width), np.int64)
    for y, (lowest, n) in enumerate(ranges):
        for x in range(plane.width):
            value = coder.state % 2**16 * n >> 16
            start, end = ((v * 2**16 + n - 1) // n for v in (value, value + 1))
            coder.advance(16, start, end - start)
            samples[y, x] = lowest + value
    coder.finish()
    return samples


CODECS = (decode_constant, decode_deflate, decode_png, decode_jxl, decode_context, decode_ranges)


def bilinear(grid: Doubles, y: Doubles, x: Doubles) -> Doubles:
    """Look up all channels of a grid at n places."""
    i, j = np.floor(y).astype(np.int64), np.floor(x).astype(np.int64)
    i1, j1 = np.minimum(i + 1, grid.shape[0] - 1), np.minimum(j + 1, grid.shape[1] - 1)
    fy, fx = (y - i)[:, None], (x - j)[:, None]
    upper = (1 - fx) * grid[i, j] + fx * grid[i, j1]
    lower = (1 - fx) * grid[i1, j] + fx * grid[i1, j1]
    return np.asarray((1 - fy) * upper + fy * lower)


def deform(gaussians: Values, grids: Values, tau: float) -> tuple[Doubles, ...]:
    """Move Gaussians to the time tau; return mu, s, theta, c and o of section 8.2."""
    g = {name: value.astype(np.float64) for name, value in gaussians.items()}
    f = np.zeros((len(g["position"]), 8))
    if "xy" in grids:
        xy, xt, yt = (grids[name].astype(np.float64) for name in ("xy", "xt", "yt"))
        last = np.array([xy.shape[1], xy.shape[0], xt.shape[0]]) - 1.0
        place = np.insert(g["position"], 2, tau, axis=1)
        u, v, t = ((place + 1) / 2 * last).clip(0, last).T
        f = (1 - g["indicator"]) * bilinear(xy, v, u) * bilinear(xt, t, u) * bilinear(yt, t, v)
    mu = g["position"] + g["linear"] * tau + g["quadratic"] * tau**2 + f[:, :2]
    s = np.maximum(np.exp(g["log_scale"]) + f[:, 2:4], 0.1)
    theta, c, o = g["rotation"] + f[:, 4:5], g["colour"], np.zeros_like(mu[:, :1])
    if "log_opacity" in g:  # pictures are means
        o = (g["log_opacity"] + f[:, 5:6]).clip(-MOST_LOG_OPACITY, MOST_LOG_OPACITY)
    else:
        c = c + f[:, 5:]
    return mu, s, theta, c, o


def end_look(gaussians: Values, gop: Gop, sign: int) -> Values:
    """Return the look (section 8.3) in the first (-1) or the last frame (1) of a GOP."""
    mu, s, theta, c, o = deform(gaussians, gop.values, float(sign if len(gop.pts) > 1 else 0))
    log_scale = gaussians["log_scale"]
    if "xy" in gop.values:
        log_scale = np.where(gaussians["indicator"] != 1, np.log(s), log_scale)
    parts = zip(LOOK, (mu, log_scale, theta, c, o), strict=True)
    return {name: value.astype(np.float32) for name, value in parts if name in gaussians}


def standing(look: Values) -> Values:
    """Return Gaussians that have a look and no motion."""
    still = np.zeros_like(look["position"])
    return look | {"indicator": still[:, :1] + 1, "linear": still, "quadratic": still.copy()}


def change_units(look: Values) -> Values:
    """Return what a stored change of 1 adds to the attributes of a look (section 8.3)."""
    l0, l1 = look["log_scale"].astype(np.float64).T
    o = look.get("log_opacity", np.zeros((len(l0), 1))).astype(np.float64)[:, 0]
    area, shape = l0 + l1, np.minimum(abs(l0 - l1), 4)
    eighths = {
        "position": 3 * area - 4 * shape - o,
        "log_scale": -area - shape - o,
        "rotation": area - 7 * shape,
        "colour": -2 * area - o,
        "log_opacity": 0 * area,
    }
    return {name: np.exp(value / 8)[:, None] for name, value in eighths.items()}


def carry_over(look: Values, gop: Gop) -> Values:
    """Return the Gaussians that a predicted GOP takes over from its reference (section 8.3)."""
    kept = gop.modes != DROPPED
    changed, moved = (gop.modes[kept] & 2) > 0, (gop.modes[kept] & 1) > 0
    result = standing({name: value[kept] for name, value in look.items()})
    units = change_units({name: value[changed] for name, value in result.items()})
    for name in look:
        if changed.any():
            added = units[name] * gop.values[f"{name}_change"]
            result[name][changed] = result[name][changed] + added
        result[name] = clamp(name, result[name])
    for name in ("indicator", "linear", "quadratic") if moved.any() else ():
        result[name][moved] = gop.values[f"carried_{name}"]
    start = -1 - 2 / (len(gop.pts) - 1) if len(gop.pts) > 1 else -1.0
    linear, quadratic = (result[name].astype(np.float64) for name in ("linear", "quadratic"))
    position = result["position"].astype(np.float64) - (start * linear + start**2 * quadratic)
    return result | {"position": clamp("position", position)}


def mix_looks(a: Values, b: Values, kept: npt.NDArray[np.bool_], w: float) -> Values:
    """Mix the looks of a GOP and of the GOP predicted from it (section 8.1)."""
    carried = np.count_nonzero(kept)
    mixed: Values = {}
    for name in a:
        gone, come = a[name][~kept].astype(np.float64), b[name][carried:].astype(np.float64)
        if name == "log_opacity":
            gone, come = gone + math.log(max(1 - w, 2**-16)), come + math.log(max(w, 2**-16))
        elif name == "colour" and "log_opacity" not in a:
            gone, come = (1 - w) * gone, w * come
        both = (1 - w) * a[name][kept].astype(np.float64) + w * b[name][:carried]
        mixed[name] = np.concatenate([both, gone, come]).astype(np.float32)
    return standing(mixed)


def plate_weights(size: int, coded: int) -> Doubles:
    """Return how much each coded column (or row) of a plate weighs in each drawn one."""
    at = (np.arange(size) + 0.5) * coded / size
    apart = abs(np.arange(coded) + 0.5 - at[:, None])
    weights = np.maximum(1 - apart / max(1, coded / size), 0)
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def draw_plate(plate: npt.NDArray[np.uint8], width: int, height: int) -> Doubles:
    """Return the colours of a plate (section 5.7) in a picture of a size (section 8.5)."""
    y, cb, cr = np.moveaxis(plate - np.array([0.0, 128, 128]), -1, 0)
    rgb = np.stack([y + 1.402 * cr, y - 0.344136 * cb - 0.714136 * cr, y + 1.772 * cb]) / 255
    rows, columns = plate_weights(height, len(plate)), plate_weights(width, plate.shape[1])
    return np.moveaxis(rows @ rgb @ columns.T, 0, -1)


def render(
    gaussians: Values,
    grids: Values,
    tau: float,
    sides: tuple[int, ...],
    plate: npt.NDArray[np.uint8] | None,
) -> Doubles:
    """Return the picture of section 8.5, [height, width, 3]; sides are Wc, Hc, W, H."""
    width, height = sides[2:]
    zx, zy = width / sides[0], height / sides[1]
    z = min(zx, zy)
    mu, s, theta, c, o = deform(gaussians, grids, tau)
    bounds = np.array([math.log(2**i / z) for i in (1, 2, 3, 4)], np.float32)
    level = (gaussians["log_scale"].min(axis=1, keepdims=True) >= bounds).sum(axis=1, keepdims=True)
    area = 4.0**level / z**2
    squared = s**2
    fine = squared + 0.1 + max(1 / z**2 - 1, 0) / 4
    v = np.where(level == 0, fine, np.maximum(squared - 3 / 16 * area, area / 2))
    a = np.sqrt((squared + 0.1).prod(axis=1) / v.prod(axis=1))[:, None]
    factors = a * np.exp(o) * np.append(c, np.ones_like(a), axis=1)
    scale = np.array([zx, zy]) / 2.0**level
    centre = (mu + 1) * np.array([width, height]) / 2 / 2.0**level
    cos, sin = np.cos(theta), np.sin(theta)
    reach = scale * np.sqrt(2 * math.log(64) * (v * cos**2 + v[:, ::-1] * sin**2))
    pictures = [np.zeros((-(-height // 2**i), -(-width // 2**i), 4)) for i in range(5)]
    size = np.array([picture.shape[1::-1] for picture in pictures])[level[:, 0]]
    first = np.floor(centre - reach).clip(0, size).astype(np.int64)
    end = np.ceil(centre + reach).clip(0, size).astype(np.int64)
    for n in range(len(level)):
        picture = pictures[level[n, 0]]
        columns, rows = slice(first[n, 0], end[n, 0]), slice(first[n, 1], end[n, 1])
        dx = (np.arange(first[n, 0], end[n, 0]) + 0.5 - centre[n, 0]) / scale[n, 0]
        dy = (np.arange(first[n, 1], end[n, 1])[:, None] + 0.5 - centre[n, 1]) / scale[n, 1]
        # The distance in the axes of the Gaussian: nothing cancels, unlike in the determinant.
        along, across = cos[n] * dx + sin[n] * dy, cos[n] * dy - sin[n] * dx
        weight = np.exp(-(along**2 / v[n, 0] + across**2 / v[n, 1]) / 2) - 1 / 64
        picture[rows, columns] += weight.clip(0)[:, :, None] * factors[n]
    image = pictures[4]
    for picture in pictures[3::-1]:
        image = picture + magnify(image)[: picture.shape[0], : picture.shape[1]]
    if plate is not None:
        image[:, :, :3] += draw_plate(plate, width, height)
        image[:, :, 3] += 1
    divisor = 1 / 1024 + image[:, :, 3:] if "log_opacity" in gaussians else 1
    return image[:, :, :3] / divisor


def magnify(picture: Doubles) -> Doubles:
    """Double both sides of a picture: up() of section 8.5."""
    for axis in (1, 0):
        p = picture.swapaxes(0, axis)
        before, after = np.concatenate([p[:1], p[:-1]]), np.concatenate([p[1:], p[-1:]])
        pair = np.stack([before / 4 + p * 0.75, p * 0.75 + after / 4], axis=1)
        picture = pair.reshape(-1, *p.shape[1:]).swapaxes(0, axis)
    return picture


class Film:
    """A GSVR file, read in the order of section 11."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.header, first = read_header(data)
        self.warnings: list[str] = []  # why the file should be decoded on request only
        try:
            self.chunks, kinds = read_index(data, first)
        except Corrupt as fault:
            self.chunks, kinds, faults = walk(data, first)
            if faults or b"fend" in kinds or not self.header.flags & STREAM:
                self.warnings = [f"There is no valid index: {fault}", *faults]
        for kind in kinds:
            require(kind != b"HEAD", "The file has a second header.")
            if kind[:1].isupper() and kind != b"GOPD":
                raise Unsupported(f"The critical chunk {kind.decode()} is not known.")
        self._references: list[int | None] = []  # the index of the reference; None = none, missing
        self._gops: dict[int, Gop] = {}
        self._gaussians: dict[int, Values] = {}
        starts, depth = dict[int, int](), dict[int | None, int]({None: 0})
        for i, chunk in enumerate(self.chunks):
            before = starts.get(chunk.first_frame - chunk.reference)
            self._references.append(before)
            depth[i] = depth[before] + 1
            limit(depth[i], LIMIT_CHAIN, "GOPs in a chain of references")
            starts[chunk.first_frame] = i
        require(self.chunks, "The file has no GOP.")

    def _own(self, index: int) -> Gop:
        """Decode a GOP without its reference."""
        if index not in self._gops:
            chunk = self.chunks[index]
            try:
                kind, payload, sound = read_chunk(self.data, chunk.offset)
                found = (kind, len(payload), sound)
                require(found == (b"GOPD", chunk.length, True), "Wrong type, length or CRC.")
                self._gops[index] = read_gop(payload, chunk, self.header)
            except (Corrupt, Unsupported) as fault:
                raise type(fault)(f"GOP chunk at byte {chunk.offset}: {fault}") from fault
        return self._gops[index]

    def _chain(self, index: int) -> list[int]:
        """Decode a GOP and its references; return their indices from the key GOP on."""
        chain, gop = [index], self._own(index)
        while gop.chunk.reference:
            before = self._references[chain[0]]
            if before is None:
                raise Corrupt("The reference of a predicted GOP is missing.")
            reference = self._own(before)
            same = reference.chunk.gaussians == gop.reference_gaussians
            require(same, "The reference of a predicted GOP has another number of Gaussians.")
            chain.insert(0, before)
            gop = reference
        return chain

    @property
    def gops(self) -> Iterator[Gop]:
        """All GOPs, decoded and checked as they are asked for."""
        return (self._gops[self._chain(index)[-1]] for index in range(len(self.chunks)))

    def gaussians(self, index: int) -> Values:
        """Return all Gaussians of a GOP, those carried over included."""
        chain = self._chain(index)
        for before, i in zip([-1, *chain[:-1]], chain, strict=True):
            gop = self._gops[i]
            if i not in self._gaussians:
                names = [name for name in NEW if self.header.mean or name != "log_opacity"]
                empty = {name: np.zeros((0, NEW[name].components)) for name in names}
                own = {name: gop.values.get(name, empty[name]) for name in names}
                if gop.chunk.reference:
                    last = end_look(self._gaussians[before], self._gops[before], 1)
                    carried = carry_over(last, gop)
                    own = {name: np.concatenate([carried[name], own[name]]) for name in names}
                self._gaussians[i] = {name: v.astype(np.float32) for name, v in own.items()}
        return self._gaussians[index]

    def plate(self, index: int) -> npt.NDArray[np.uint8] | None:
        """Return the plate of a GOP, which is that of the key GOP of its chain."""
        return self._gops[self._chain(index)[0]].values.get("plate")

    def picture(self, time: Fraction, width: int, height: int) -> Doubles:
        """Render a picture at a time in ticks."""
        sides = (self.header.width, self.header.height, width, height)
        index = bisect_right([chunk.first_pts for chunk in self.chunks], time) - 1
        require(index >= 0, f"The time {time} is before the first frame.")
        here, gop, plate = self.gaussians(index), self._gops[index], self.plate(index)
        end = Fraction(gop.pts[-1])
        if time <= end or index + 1 == len(self.chunks):
            return render(here, gop.values, gop.tau(min(time, end)), sides, plate)
        there, after = self.gaussians(index + 1), self._gops[index + 1]
        w = float((time - end) / (after.pts[0] - end))
        if self._references[index + 1] == index:
            looks = end_look(here, gop, 1), end_look(there, after, -1)
            return render(mix_looks(*looks, after.modes != DROPPED, w), {}, 0.0, sides, plate)
        # The file does not tell where its cuts are; both frames are taken for one shot.
        old = render(here, gop.values, gop.tau(end), sides, plate)
        start = after.tau(Fraction(after.pts[0]))
        new = render(there, after.values, start, sides, self.plate(index + 1))
        return (1 - w) * old + w * new


def write_png(path: Path, picture: Doubles, bits: int) -> None:
    """Write the codes of a picture (section 8.5) as PNG of 8 or 16 bits a sample."""
    height, width, _ = picture.shape
    codes = np.floor((2**bits - 1) * picture.clip(0, 1) + 0.5)
    raw = codes.astype(np.uint8 if bits == 8 else ">u2").reshape(height, -1)
    rows = b"".join(b"\0" + row.tobytes() for row in raw)
    header = struct.pack(">2I5B", width, height, 8 if bits == 8 else 16, 2, 0, 0, 0)
    body = png_chunk(b"IHDR", header) + png_chunk(b"IDAT", zlib.compress(rows))
    path.write_bytes(PNG_SIGNATURE + body + png_chunk(b"IEND", b""))


def decode_vector(path: Path, out: Path) -> None:
    """Write the values and the pictures of one vector."""
    film = Film(path.read_bytes())
    gops = []
    for gop in film.gops:
        values = {}
        for name, value in gop.values.items():
            digest = hashlib.sha256(value.tobytes()).hexdigest()
            values[name] = {"shape": list(value.shape), "sha256": digest}
        about = {"first_frame": gop.chunk.first_frame, "reference": gop.chunk.reference}
        gops.append({**about, "pts": gop.pts, "durations": gop.durations, "values": values})
    (out / f"{path.stem}.json").write_text(json.dumps({"gops": gops}, indent=1) + "\n")
    wanted = path.with_suffix(".json")
    for entry in json.loads(wanted.read_text()).get("pictures", []) if wanted.exists() else []:
        picture = film.picture(Fraction(entry["time"]), entry["width"], entry["height"])
        write_png(out / entry["file"], picture, entry["bits"])


def main(arguments: list[str]) -> int:
    """Run the command line; return its exit code."""
    if len(arguments) == 2:
        out = Path(arguments[1])
        out.mkdir(parents=True, exist_ok=True)
        for path in sorted(Path(arguments[0]).glob("*.gsvr")):
            decode_vector(path, out)
        return 0
    try:
        film = Film(Path(arguments[0]).read_bytes())
        require(not film.warnings, " ".join(film.warnings))  # decoded only on request
        frames = [len(gop.pts) for gop in film.gops]
    except (Corrupt, Unsupported) as fault:
        print(f"{type(fault).__name__}: {fault}", file=sys.stderr)
        return 3 if isinstance(fault, Corrupt) else 4
    print(f"{sum(frames)} frames in {len(frames)} GOPs")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
