"""Small GOPs and .gsvr files made in memory, for the tests of the bitstream."""

from __future__ import annotations

import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import fields
from fractions import Fraction

import numpy as np

from gsvrcodec.bitstream.gop_chain import GopUnpacker, WholeGop
from gsvrcodec.bitstream.gop_payload import pack_gop
from gsvrcodec.bitstream.header import Header
from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.bitstream.writer import GsvrWriter
from gsvrcodec.encoder.results import EncodedGop
from gsvrcodec.limits import Limits
from gsvrcodec.model.attributes import triplane_channels
from gsvrcodec.model.gop import Float32Array, Gop
from gsvrcodec.model.prediction import CHANGED, DROPPED, MOVED, Carried, Modes
from gsvrcodec.model.quantise import Precision, Refined
from gsvrcodec.model.reconstruction import Blending
from gsvrcodec.model.refinement import Refinement
from gsvrcodec.planes import PACKS

#: Fixed here, so that test vectors do not change when a profile is tuned.
BITS: Mapping[str, int] = {
    "position": 13,
    "log_scale": 8,
    "rotation": 7,
    "colour": 10,
    "log_opacity": 7,
    "indicator": 6,
    "linear": 11,
    "quadratic": 9,
    "xy": 10,
    "xt": 8,
    "yt": 8,
}
SIXTEEN_BITS: Mapping[str, int] = dict.fromkeys(BITS, 16)
#: Bits of base values, and up to three more for new Gaussians.
REFINED: Precision = {
    **BITS,
    "position": Refined((0.02, 0.02), Refinement(-2, 3)),
    "log_scale": Refined((0.1, 0.1), Refinement(0, 2)),
    "rotation": Refined((math.pi / 16,), Refinement(0, 3)),
    "colour": Refined((0.02, 0.02, 0.02), Refinement(0, 1)),
    "linear": Refined((0.002, 0.002), Refinement(-8, 8)),
}

HEADER = Header(width=64, height=48, time_base=Fraction(1, 1000))


def make_gop(
    gaussians: int,
    grid: tuple[int, int, int] = (0, 0, 0),
    seed: int = 0,
    blending: Blending = "mean",
) -> Gop:
    """A GOP of random values of usual size."""
    draw = np.random.default_rng(seed)
    gx, gy, gt = grid

    def normal(mean: float, spread: float, *shape: int) -> Float32Array:
        values: Float32Array = (mean + spread * draw.standard_normal(shape)).astype(np.float32)
        return values

    gop = Gop(
        position=draw.uniform(-1, 1, (gaussians, 2)).astype(np.float32),
        log_scale=normal(1, 0.5, gaussians, 2),
        rotation=draw.uniform(0, 3, gaussians).astype(np.float32),
        colour=normal(0.3, 0.2, gaussians, 3),
        indicator=draw.uniform(0, 1, gaussians).astype(np.float32),
        linear=normal(0, 0.02, gaussians, 2),
        quadratic=normal(0, 0.01, gaussians, 2),
        xy=normal(0, 0.02, gy, gx, 8),
        xt=normal(1, 0.1, gt, gx, 8),
        yt=normal(1, 0.1, gt, gy, 8),
        log_opacity=normal(0, 1, gaussians),
    )
    if blending == "sum":
        gop.log_opacity[:] = 0
    else:
        for plane in (gop.xy, gop.xt, gop.yt):
            plane[..., triplane_channels(blending) :] = 0
    return gop


def make_payload(
    gaussians: int = 20,
    grid: tuple[int, int, int] = (0, 0, 0),
    *,
    frames: int = 3,
    first_frame: int = 0,
    start_pts: int = 0,
    pack: str = "deflate",
    bits: Precision = BITS,
    seed: int = 0,
    reference: int = 0,
    carried: Carried | None = None,
    blending: Blending = "mean",
) -> bytes:
    """The payload of a GOP of 40-tick frames; of a predicted one with so many new Gaussians."""
    pts = start_pts + 40 * np.arange(frames, dtype=np.int64)
    return pack_gop(
        make_gop(gaussians, grid, seed, blending),
        pts,
        np.full(frames, 40, np.int64),
        first_frame,
        bits,
        PACKS[pack],
        reference=reference,
        carried=carried,
        blending=blending,
    )


def make_modes(gaussians: int, seed: int = 0) -> Modes:
    """Modes of the Gaussians of a reference, of each kind about as many."""
    modes = np.arange(gaussians) % (DROPPED + 1)
    return np.random.default_rng(seed).permutation(modes).astype(np.uint8)


def make_carried(mode: Modes, seed: int = 0, blending: Blending = "mean") -> Carried:
    """Random changes and motions of usual size."""
    draw = np.random.default_rng(seed)
    changed = int(np.count_nonzero(mode & CHANGED))
    moved = int(np.count_nonzero(mode & MOVED))

    def normal(spread: float, *shape: int) -> Float32Array:
        values: Float32Array = (spread * draw.standard_normal(shape)).astype(np.float32)
        return values

    return Carried(
        mode=mode,
        position=normal(0.05, changed, 2),
        log_scale=normal(0.2, changed, 2),
        rotation=normal(0.3, changed),
        colour=normal(0.1, changed, 3),
        indicator=draw.uniform(0, 1, moved).astype(np.float32),
        linear=normal(0.02, moved, 2),
        quadratic=normal(0.01, moved, 2),
        log_opacity=normal(0.5, changed) * np.float32(blending == "mean"),
    )


def encoded(
    frames: range,
    payload: bytes,
    *,
    psnr: float = 30.0,
    float_psnr: float = 31.0,
    qscale: float | None = 1.5,
) -> EncodedGop:
    """Return a payload as a finished job does."""
    return EncodedGop(
        frames=frames,
        psnr=psnr,
        float_psnr=float_psnr,
        seconds=1.0,
        qscale=qscale,
        payload=payload,
    )


def make_chain(
    frames: Sequence[int] = (3, 2, 1, 4),
    gaussians: int = 30,
    new: int = 5,
    *,
    grid: tuple[int, int, int] = (3, 2, 4),
    pack: str = "deflate",
    bits: Precision = BITS,
    references: Sequence[int] | None = None,
    blending: Blending = "mean",
) -> list[bytes]:
    """Payloads of a chain: a key GOP, and GOPs with Gaussians of every mode.

    Args:
        frames: Frames of each GOP.
        gaussians: Gaussians of the key GOP.
        new: New Gaussians of each other GOP.
        grid: Tri-plane of each GOP that has more than one frame.
        pack: Plane codecs.
        bits: Bits of each attribute.
        references: Number of the GOP that each predicted GOP refers to; None = the one before.
        blending: How pictures are formed.
    """
    payloads = [
        make_payload(gaussians, grid, frames=frames[0], pack=pack, bits=bits, blending=blending)
    ]
    counts, firsts = [gaussians], [0]
    for number in range(1, len(frames)):
        reference = number - 1 if references is None else references[number - 1]
        mode = make_modes(counts[reference], seed=number)
        firsts.append(firsts[-1] + frames[number - 1])
        payloads.append(
            make_payload(
                new,
                grid if frames[number] > 1 else (0, 0, 0),
                frames=frames[number],
                first_frame=firsts[-1],
                start_pts=40 * firsts[-1],
                pack=pack,
                bits=bits,
                seed=number,
                reference=firsts[-1] - firsts[reference],
                carried=make_carried(mode, number, blending),
                blending=blending,
            )
        )
        counts.append(int(np.count_nonzero(mode != DROPPED)) + new)
    return payloads


def make_payloads(count: int, frames: int = 3, gaussians: int = 5) -> list[bytes]:
    """Payloads of GOPs that follow each other."""
    return [
        make_payload(
            gaussians,
            frames=frames,
            first_frame=frames * number,
            start_pts=40 * frames * number,
            seed=number,
        )
        for number in range(count)
    ]


def make_file(
    payloads: list[bytes],
    header: Header = HEADER,
    auxiliary: tuple[tuple[bytes, bytes], ...] = (),
) -> bytes:
    """A whole file: auxiliary chunks after the GOPs."""
    file = io.BytesIO()
    with GsvrWriter(file, header) as writer:
        for payload in payloads:
            writer.add_gop(payload)
        for kind, data in auxiliary:
            writer.add_auxiliary(kind, data)
    return file.getvalue()


def decode_all(data: bytes, limits: Limits | None = None) -> list[WholeGop]:
    """Open a file and unpack every GOP of it, as a decoder would."""
    limits = limits or Limits()
    with GsvrReader(io.BytesIO(data), limits) as reader:
        reader.settings()
        unpacker = GopUnpacker(reader, limits)
        return [unpacker.unpack(position) for position in range(len(reader.gops))]


def assert_gops_equal(left: Gop, right: Gop) -> None:
    """Both hold the same values, bit for bit."""
    for field in fields(Gop):
        np.testing.assert_array_equal(getattr(left, field.name), getattr(right, field.name))


def moved(payload: bytes, gop: int, frames: int) -> bytes:
    """The payload of a GOP of so many frames as the `gop`th of a film."""
    changed = bytearray(payload)
    changed[0:8] = (frames * gop).to_bytes(8, "little")
    for offset in (16, 24):
        pts = int.from_bytes(payload[offset : offset + 8], "little") + 40 * frames * gop
        changed[offset : offset + 8] = pts.to_bytes(8, "little")
    return bytes(changed)
