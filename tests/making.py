"""Small files that the tests make for themselves, and where the sample clips lie."""

from __future__ import annotations

import json
import os
import wave
from collections.abc import Sequence
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from numpy.typing import NDArray

from gsvrcodec.bitstream.gop_payload import pack_gop
from gsvrcodec.bitstream.header import ColourInfo, Header
from gsvrcodec.bitstream.writer import GsvrWriter
from gsvrcodec.model.attributes import ATTRIBUTES
from gsvrcodec.model.gop import Float32Array, Gop
from gsvrcodec.model.reconstruction import Blending
from gsvrcodec.model.static import select_gaussians
from gsvrcodec.video import OutputInfo, open_writer
from tests.gops import make_carried, make_modes

SAMPLES = Path(__file__).parent.parent / "samples"
BUNNY = SAMPLES / "bigbuckbunny.mp4"
BUNNY_SMALL = SAMPLES / "bunny_24f_320x180_audio.mp4"
TEN_BIT = SAMPLES / "bunny_10bit_12f_320x180.mkv"
ODD = SAMPLES / "city_cut_odd_24f_241x135.webm"
VFR_ROTATED = SAMPLES / "cup_vfr_rot90_16f_320x240.mp4"
NOISE = SAMPLES / "tree_noise_20f_160x120.mp4"

#: More clips, for those who have them: GSVR_TEST_CLIPS names their directory.
CLIPS = Path(os.environ.get("GSVR_TEST_CLIPS", "clips-not-given"))
needs_clips = pytest.mark.skipif(not CLIPS.is_dir(), reason="GSVR_TEST_CLIPS is not set")

Rgb = NDArray[np.uint8]


def psnr(a: NDArray[np.uint8 | np.uint16], b: NDArray[np.uint8 | np.uint16]) -> float:
    """Return the PSNR of two 8-bit pictures in dB, 100 when they are equal."""
    error = float(np.mean((a.astype(np.float64) - b) ** 2))
    return 10 * np.log10(255**2 / error) if error else 100.0


def colour_bars(width: int = 160, height: int = 96) -> Rgb:
    """Return eight full bars over a grey ramp, the bars 16-pixel aligned."""
    corners = [(r, g, b) for r in (0, 255) for g in (0, 255) for b in (0, 255)]
    columns = np.array(corners, np.uint8)[np.arange(width) * 8 // width]
    ramp = np.linspace(0, 255, width).astype(np.uint8)[:, None].repeat(3, axis=1)
    half = height // 2
    return np.concatenate([columns[None].repeat(half, 0), ramp[None].repeat(height - half, 0)])


def output_info(
    pictures: list[Rgb], *, time_base: Fraction = Fraction(1, 25), colour: ColourInfo | None = None
) -> OutputInfo:
    """Return what a writer must know of pictures shown at 25 a second."""
    height, width = pictures[0].shape[:2]
    return OutputInfo(
        width=width,
        height=height,
        time_base=time_base,
        rate=Fraction(25),
        frames=len(pictures),
        colour=colour or ColourInfo(),
    )


def write_video(path: Path, pictures: list[Rgb], info: OutputInfo | None = None) -> Path:
    """Write pictures at one tick each."""
    with open_writer(path, info or output_info(pictures)) as writer:
        for pts, rgb in enumerate(pictures):
            writer.write(rgb, pts, 1)
    return path


def raw_stream(path: Path) -> Path:
    """Write the small Bunny's H.264 without container, and so without timestamps."""
    with av.open(BUNNY_SMALL) as source, av.open(path, "w", format="h264") as target:
        stream = target.add_stream_from_template(source.streams.video[0])
        for packet in source.demux(source.streams.video[0]):
            if packet.dts is not None:
                packet.stream = stream
                target.mux(packet)
    return path


def audio_only(path: Path) -> Path:
    """Write a tenth of a second of silence as a WAV file."""
    with wave.open(str(path), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(8000)
        file.writeframes(bytes(1600))
    return path


def audio_with_cover(path: Path) -> Path:
    """Write a sound track whose only picture is its cover."""
    with av.open(path, "w", format="mp4") as file:
        audio = file.add_stream("aac", rate=44100)
        cover = file.add_stream("mjpeg", rate=25)
        cover.width, cover.height, cover.pix_fmt = 64, 48, "yuvj420p"
        cover.disposition = av.stream.Disposition.attached_pic
        silence = np.zeros((2, 1024), np.float32)
        samples = av.AudioFrame.from_ndarray(silence, format="fltp", layout="stereo")
        samples.sample_rate = 44100
        file.mux(audio.encode(samples))
        file.mux(cover.encode(av.VideoFrame(64, 48, "yuvj420p")))
        file.mux([*cover.encode(None), *audio.encode(None)])
    return path


def zero_frames(path: Path) -> Path:
    """Write a Y4M file that ends after its header."""
    path.write_bytes(b"YUV4MPEG2 W64 H48 F25:1 Ip A1:1 C420jpeg\n")
    return path


def random_gop(
    rng: np.random.Generator, gaussians: int = 60, grid: tuple[int, int, int] = (4, 3, 5)
) -> Gop:
    """Return Gaussians of middling size that move a little."""
    gx, gy, gt = grid

    def normal(*shape: int, sigma: float = 1.0) -> Float32Array:
        return rng.normal(0, sigma, shape).astype(np.float32)

    return Gop(
        position=rng.uniform(-1, 1, (gaussians, 2)).astype(np.float32),
        log_scale=rng.uniform(0, 2, (gaussians, 2)).astype(np.float32),
        rotation=rng.uniform(0, np.pi, gaussians).astype(np.float32),
        colour=rng.uniform(-0.3, 1.3, (gaussians, 3)).astype(np.float32),
        indicator=rng.uniform(0, 1, gaussians).astype(np.float32),
        linear=normal(gaussians, 2, sigma=0.1),
        quadratic=normal(gaussians, 2, sigma=0.05),
        xy=normal(gy, gx, 8, sigma=0.05),
        xt=1 + normal(gt, gx, 8, sigma=0.05),
        yt=1 + normal(gt, gy, 8, sigma=0.05),
        log_opacity=normal(gaussians),
    )


@cache
def _payloads(
    frames: tuple[int, ...],
    times: tuple[tuple[int, int], ...],
    grid: tuple[int, int, int],
    one_shot: bool,
    predicted: bool,
    blending: Blending,
) -> list[bytes]:
    """GOPs of random Gaussians; kept, for many tests ask for the same."""
    rng = np.random.default_rng(7)
    bits = dict.fromkeys((attribute.name for attribute in ATTRIBUTES), 12)
    found: list[bytes] = []
    first = gaussians = 0
    for count in frames:
        pts, durations = np.array(times[first : first + count], np.int64).T
        gop = random_gop(np.random.default_rng(7) if one_shot else rng, grid=grid)
        if one_shot:
            gop.linear[:] /= 9
            gop.quadratic[:] /= 9
        if predicted and found:
            new = select_gaussians(gop, np.arange(len(gop)) < 12)
            carried = make_carried(make_modes(gaussians, len(found)), len(found), blending)
            reference = frames[len(found) - 1]
            gaussians = carried.kept + len(new)
        else:
            new, carried, reference = gop, None, 0
            gaussians = len(gop)
        found.append(
            pack_gop(
                new,
                pts,
                durations,
                first,
                bits,
                reference=reference,
                carried=carried,
                blending=blending,
            )
        )
        first += count
    return found


def gsvr_file(
    path: Path,
    *,
    frames: Sequence[int] = (5, 3, 4),
    size: tuple[int, int] = (48, 32),
    times: Sequence[tuple[int, int]] | None = None,
    time_base: Fraction = Fraction(1, 12800),
    settings: dict[str, Any] | None = None,
    auxiliary: dict[bytes, bytes] | None = None,
    grid: tuple[int, int, int] = (4, 3, 5),
    close: bool = True,
    one_shot: bool = False,
    predicted: bool = False,
    **header: Any,
) -> Path:
    """Write a .gsvr file of random Gaussians.

    Args:
        path: the file to write.
        frames: frames of each GOP.
        size: width and height, pixels.
        times: timestamp and duration of every frame, ticks; None = 512 ticks each from 0.
        time_base: seconds a tick.
        settings: content of the chunk "sett"; None = no such chunk.
        auxiliary: further chunks, by type.
        grid: size of the tri-planes.
        close: False = leave out index and end, as a killed encoder does.
        one_shot: True = the same Gaussians in every GOP, which move little.
        predicted: True = every GOP but the first is predicted from the one before it.
        header: further fields of the header.
    """
    if times is None:
        times = [(512 * number, 512) for number in range(sum(frames))]
    fields = Header(width=size[0], height=size[1], time_base=time_base, **header)
    with path.open("w+b") as file:
        writer = GsvrWriter(file, fields)
        for payload in _payloads(
            tuple(frames), tuple(map(tuple, times)), grid, one_shot, predicted, fields.blending
        ):
            writer.add_gop(payload)
        if settings is not None:
            writer.add_auxiliary(b"sett", json.dumps(settings).encode())
        for kind, payload in (auxiliary or {}).items():
            writer.add_auxiliary(kind, payload)
        if close:
            writer.close()
    return path
