"""Small GOPs and .gsvr files made in memory, for the tests of the bitstream."""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import fields, replace
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.bitstream.background_payload import pack_background, unpack_background
from gsvrcodec.bitstream.gop_payload import GopContent, pack_gop, unpack_gop
from gsvrcodec.bitstream.header import Header
from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.bitstream.writer import GsvrWriter
from gsvrcodec.errors import CorruptError
from gsvrcodec.limits import Limits
from gsvrcodec.model.background import append_background
from gsvrcodec.model.gop import Float32Array, Gop
from gsvrcodec.planes import PACKS

#: Fixed here, so that test vectors do not change when a profile is tuned.
BITS: Mapping[str, int] = {
    "position": 13,
    "log_scale": 8,
    "rotation": 7,
    "colour": 10,
    "indicator": 6,
    "linear": 11,
    "quadratic": 9,
    "xy": 10,
    "xt": 8,
    "yt": 8,
}
SIXTEEN_BITS: Mapping[str, int] = dict.fromkeys(BITS, 16)

HEADER = Header(width=64, height=48, time_base=Fraction(1, 1000))


def make_gop(gaussians: int, grid: tuple[int, int, int] = (0, 0, 0), seed: int = 0) -> Gop:
    """A GOP of random values of usual size."""
    draw = np.random.default_rng(seed)
    gx, gy, gt = grid

    def normal(mean: float, spread: float, *shape: int) -> Float32Array:
        values: Float32Array = (mean + spread * draw.standard_normal(shape)).astype(np.float32)
        return values

    return Gop(
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
    )


def make_payload(
    gaussians: int = 20,
    grid: tuple[int, int, int] = (0, 0, 0),
    *,
    frames: int = 3,
    first_frame: int = 0,
    start_pts: int = 0,
    pack: str = "deflate",
    bits: Mapping[str, int] = BITS,
    seed: int = 0,
    background: int = 0,
    shown: NDArray[np.bool_] | None = None,
) -> bytes:
    """The payload of a GOP of 40-tick frames."""
    pts = start_pts + 40 * np.arange(frames, dtype=np.int64)
    return pack_gop(
        make_gop(gaussians, grid, seed),
        pts,
        np.full(frames, 40, np.int64),
        first_frame,
        bits,
        PACKS[pack],
        background=background,
        shown=shown,
    )


def make_background(number: int, gaussians: int, *, seed: int = 9) -> bytes:
    """The payload of a background."""
    return pack_background(number, make_gop(gaussians, (0, 0, 0), seed), BITS, PACKS["entropy"])


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
    backgrounds: Mapping[int, bytes] | None = None,
) -> bytes:
    """A whole file: auxiliary chunks after the GOPs, backgrounds before the GOPs at their keys."""
    file = io.BytesIO()
    with GsvrWriter(file, header) as writer:
        for position, payload in enumerate(payloads):
            if backgrounds and position in backgrounds:
                writer.add_background(backgrounds[position])
            writer.add_gop(payload)
        for kind, data in auxiliary:
            writer.add_auxiliary(kind, data)
    return file.getvalue()


def decode_all(data: bytes, limits: Limits | None = None) -> list[GopContent]:
    """Open a file and unpack every GOP of it, as a decoder would."""
    limits = limits or Limits()
    with GsvrReader(io.BytesIO(data), limits) as reader:
        reader.settings()
        contents = []
        for position, entry in enumerate(reader.gops):
            try:
                content = unpack_gop(reader.read_gop(position), reader.header, limits)
            except CorruptError as error:
                raise error.located(entry.chunk.name, entry.offset) from error
            contents.append(content)
        for number, content in enumerate(contents):
            if content.shown is not None:
                chunk = reader.find_background(content.background, number).chunk
                background = unpack_background(reader.read_chunk(chunk), limits)
                gop = append_background(content.gop, background, content.shown)
                contents[number] = replace(content, gop=gop)
        return contents


def assert_gops_equal(left: Gop, right: Gop) -> None:
    """Both hold the same values, bit for bit."""
    for field in fields(Gop):
        np.testing.assert_array_equal(getattr(left, field.name), getattr(right, field.name))
