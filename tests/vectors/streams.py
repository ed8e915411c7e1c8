"""Files that every decoder must read, made of random Gaussians or from films."""

from __future__ import annotations

import io
import json
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any
from unittest import mock

import cv2
import numpy as np

import gsvrcodec
from gsvrcodec.bitstream.chunk import GOP_TYPE, HEAD_TYPE, METADATA_TYPE
from gsvrcodec.bitstream.gop_head import GOP_HEAD_BYTES, SUMMARY_BYTES
from gsvrcodec.bitstream.gop_payload import pack_gop
from gsvrcodec.bitstream.header import ColourInfo, Header
from gsvrcodec.bitstream.writer import GsvrWriter
from gsvrcodec.model.gop import Gop
from gsvrcodec.model.prediction import CHANGED, DROPPED
from gsvrcodec.model.quantise import Precision
from gsvrcodec.model.reconstruction import MOST_LOG_OPACITY
from gsvrcodec.planes import PACKS, avif, context
from gsvrcodec.planes.table import Codec
from tests.gops import (
    BITS,
    HEADER,
    REFINED,
    SIXTEEN_BITS,
    make_carried,
    make_chain,
    make_file,
    make_gop,
    make_modes,
    make_payload,
)
from tests.tampering import Piece, edited, joined, pieces

SAMPLES = Path(__file__).parents[2] / "samples"
#: Opacities in steps of which their bounds are multiples.
OPACITIES: Precision = {**BITS, "log_opacity": (0.75,)}


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
        log_opacity=values(1.5),
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
        rotation=270,
        mirrored=True,
        bit_depth=10,
        colour=ColourInfo(1, 1, 1, True, 1),
        flags_optional=0x80000004,
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


def stream(*, ended: bool) -> bytes:
    """A file written front to back, with or without index and end."""
    file = io.BytesIO()
    writer = GsvrWriter(file, HEADER, stream=True)
    writer.add_auxiliary(METADATA_TYPE, b'{"film": {"title": "A stream"}}')
    for payload in make_chain((3, 3)):
        writer.add_gop(payload)
    if ended:
        writer.close()
    return file.getvalue()


def levels(width: int, height: int) -> bytes:
    """Gaussians of all levels of the pyramid, one out of two of them static."""
    gop = make_gop(60, (5, 3, 4), seed=width)
    draw = np.random.default_rng(height)
    gop.log_scale[:] = draw.uniform(-1.5, 4.2, 60)[:, None] + draw.uniform(-0.4, 0.4, (60, 2))
    gop.log_scale[:] = np.minimum(gop.log_scale, np.log(0.9 * max(width, height)))
    gop.colour[:] *= np.float32(0.5)
    gop.indicator[::2] = 1
    gop.linear[::2] = gop.quadratic[::2] = 0
    payload = pack_gop(gop, np.array([0, 40, 80]), np.full(3, 40), 0, BITS)
    return make_file([payload], replace(HEADER, width=width, height=height))


def _small(gop: Gop, *others: bytes) -> bytes:
    """Small pictures of a key GOP of two frames, and GOPs that follow it."""
    key = pack_gop(gop, np.array([0, 40]), np.full(2, 40), 0, OPACITIES)
    return make_file([key, *others], replace(HEADER, width=40, height=30))


def opacities() -> bytes:
    """Opacities at both bounds, and changes that go beyond them in a predicted GOP."""
    gop, new = make_gop(24, seed=12), make_gop(2, seed=2)
    gop.log_opacity[:] = np.resize([-MOST_LOG_OPACITY, MOST_LOG_OPACITY, -4, 4], 24)
    new.log_opacity[:] = -MOST_LOG_OPACITY, MOST_LOG_OPACITY
    carried = make_carried(np.full(24, CHANGED, np.uint8), seed=5)
    carried.log_opacity[:] = np.repeat([-24, 24, 8, -8, -8, 8], 4)
    times = np.array([80, 120]), np.full(2, 40)
    predicted = pack_gop(new, *times, 2, OPACITIES, reference=2, carried=carried)
    return _small(gop, predicted)


def a_plate(width: int, height: int, seed: int = 0) -> bytes:
    """A coded plate of soft colours."""
    draw = np.random.default_rng(seed)
    few = draw.integers(0, 256, (5, 8, 3), np.uint8)
    soft = cv2.resize(few, (width, height), interpolation=cv2.INTER_CUBIC)
    return avif.encode(np.asarray(soft, np.uint8), 60)


def plates() -> bytes:
    """A plate behind a chain, a key GOP that has none, and one that has nothing else."""
    carried, header = make_carried(make_modes(24), seed=3), replace(HEADER, width=70, height=45)
    times = [(np.array([t, t + 40]), np.full(2, 40)) for t in range(0, 320, 80)]
    new = make_gop(3, (3, 2, 2), 2)
    payloads = [
        pack_gop(make_gop(24, (4, 3, 2), 1), *times[0], 0, BITS, plate=a_plate(70, 45)),
        pack_gop(new, *times[1], 2, BITS, reference=2, carried=carried),
        pack_gop(make_gop(24, seed=4), *times[2], 4, BITS),
        pack_gop(make_gop(0), *times[3], 6, BITS, plate=a_plate(70, 45, 1)),
    ]
    return make_file(payloads, header)


def plates_kept() -> bytes:
    """A chain in front of the plate of another one: it drops all Gaussians of the key GOP."""
    header, none = replace(HEADER, width=70, height=45), np.full(24, DROPPED, np.uint8)
    times = [(np.array([t, t + 40]), np.full(2, 40)) for t in range(0, 400, 80)]
    carried = [
        make_carried(make_modes(24), seed=3),
        make_carried(none),
        make_carried(make_modes(9)),
    ]
    payloads = [
        pack_gop(make_gop(24, (4, 3, 2), 1), *times[0], 0, BITS, plate=a_plate(70, 45)),
        pack_gop(make_gop(3), *times[1], 2, BITS, reference=2, carried=carried[0]),
        pack_gop(make_gop(9, seed=4), *times[2], 4, BITS, reference=4, carried=carried[1]),
        pack_gop(make_gop(2, seed=5), *times[3], 6, BITS, reference=2, carried=carried[2]),
        pack_gop(make_gop(0), *times[4], 8, BITS, reference=8, carried=carried[1]),
    ]
    return make_file(payloads, header)


def opacities_fading() -> bytes:
    """A tri-plane that takes opacities from one bound to the other, and beyond."""
    gop = make_gop(30, (3, 2, 3), seed=7)
    gop.indicator[:] = np.resize([0, 0.5, 1], 30)
    gop.xy[..., 5] = 20
    gop.xt[..., 5] = np.array([-1, 0.1, 1])[:, None]
    gop.yt[..., 5] = 1
    return _small(gop)


def opacities_thin() -> bytes:
    """Sums of weights that vanish beside the ground."""
    gop = make_gop(40, seed=3)
    gop.log_opacity[:] = np.linspace(-MOST_LOG_OPACITY, -6, 40)
    gop.colour[:] *= 4
    return _small(gop)


def opacities_hidden() -> bytes:
    """One Gaussian hides all others, which are opaque too."""
    gop = make_gop(40, seed=6)
    gop.position[0], gop.log_scale[0] = 0, np.log(39)
    gop.linear[0] = gop.quadratic[0] = 0
    gop.log_opacity[1:] = 0
    gop.log_opacity[0] = MOST_LOG_OPACITY
    return _small(gop)


def entropy_tokens() -> bytes:
    """Planes of codec 4 with choices that suit large ones: many contexts and tokens."""
    with (
        mock.patch.object(context, "_DIVISIONS", ((7, 2),)),
        mock.patch.object(context, "_CONTEXTS", (8,)),
        mock.patch.dict(PACKS, entropy=frozenset({Codec.CONTEXT})),
    ):
        return make_file([make_payload(400, pack="entropy", seed=4)])


def film(source: str, **settings: Any) -> bytes:
    """A sample as the encoder writes it."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "film.gsvr"
        gsvrcodec.encode(SAMPLES / source, path, workers=1, **settings)
        return path.read_bytes()


def _sum(payloads: list[bytes]) -> bytes:
    """A file whose pictures are sums."""
    return make_file(payloads, replace(HEADER, blending="sum"))


def _packed(pack: str) -> Callable[[], bytes]:
    return lambda: make_file([make_payload(50, (6, 4, 3), pack=pack, seed=1)])


#: Files of random Gaussians.
RANDOM: Mapping[str, Callable[[], bytes]] = {
    "minimal": minimal,
    "black": lambda: make_file([make_payload(0)]),
    "black-triplane": lambda: make_file([make_payload(0, (2, 2, 2))]),
    "variable-rate": variable_rate,
    "newer-minor": newer_minor,
    "stream": lambda: stream(ended=True),
    "stream-growing": lambda: stream(ended=False),
    **{pack: _packed(pack) for pack in ("deflate", "png", "jxl", "entropy", "auto")},
    "entropy-strips": lambda: make_file([make_payload(400, pack="entropy", seed=2)]),
    "entropy-tokens": entropy_tokens,
    "opacities": opacities,
    "opacities-fading": opacities_fading,
    "opacities-thin": opacities_thin,
    "opacities-hidden": opacities_hidden,
    "sum": lambda: _sum([make_payload(50, (6, 4, 3), seed=1, blending="sum")]),
    "predicted-sum": lambda: _sum(make_chain((2, 2), blending="sum")),
    "predicted": lambda: make_file(make_chain()),
    "predicted-entropy": lambda: make_file(make_chain((2, 2, 2), 120, 20, pack="entropy")),
    "predicted-branches": lambda: make_file(make_chain((3, 1, 2, 2, 2), references=(0, 1, 0, 1))),
    "plates": plates,
    "plates-kept": plates_kept,
    "refined": lambda: make_file(
        [make_payload(50, (6, 4, 3), pack="entropy", bits=REFINED, seed=1)]
    ),
    "predicted-refined": lambda: make_file(make_chain((2, 2, 2), bits=REFINED)),
    "sixteen-bits": lambda: make_file([make_payload(30, (4, 3, 2), pack="jxl", bits=SIXTEEN_BITS)]),
    "sixteen-bits-entropy": lambda: make_file(
        [make_payload(30, (4, 3, 2), pack="entropy", bits=SIXTEEN_BITS)]
    ),
    "levels": lambda: levels(163, 91),
    "levels-narrow": lambda: levels(3, 200),
    "levels-1x1": lambda: levels(1, 1),
}

#: Films by the encoder; writing them again gives other Gaussians.
FILMS: Mapping[str, Callable[[], bytes]] = {
    "film-sound": lambda: film("bunny_24f_320x180_audio.mp4", crf=30, gop=8),
    "film-turned": lambda: film("cup_vfr_rot90_16f_320x240.mp4", crf=30),
    "film-odd": lambda: film("city_cut_odd_24f_241x135.webm", crf=32),
    "film-10-bits": lambda: film("bunny_10bit_12f_320x180.mkv", crf=28, crop=(160, 120, 80, 30)),
    "film-637x359": lambda: film("bigbuckbunny.mp4", crf=32, crop=(637, 359, 320, 180), frames=5),
    "film-paper": lambda: film(
        "tree_noise_20f_160x120.mp4", profile="paper", gaussians=900, frames=6, preset="fastest"
    ),
}

STREAMS: Mapping[str, Callable[[], bytes]] = {**RANDOM, **FILMS}
