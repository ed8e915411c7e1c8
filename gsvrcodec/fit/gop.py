"""Encoding of one GOP: frames in, chunk payload out; a pure function of its task."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from statistics import fmean

import numpy as np
import torch
from numpy.typing import NDArray

from gsvrcodec.fit.field import Field
from gsvrcodec.fit.flow import flow_estimator
from gsvrcodec.fit.initialise import content_aware, random_start
from gsvrcodec.fit.optimise import MAIN, PAPER, Effort, optimise
from gsvrcodec.fit.plan import triplane_grid
from gsvrcodec.fit.qat import fake_quantiser
from gsvrcodec.fit.settings import EncodeSettings
from gsvrcodec.metrics import psnr
from gsvrcodec.model.gop import Float32Array, Gop
from gsvrcodec.model.pack import dequantised, pack_gop
from gsvrcodec.model.quantise import BITS
from gsvrcodec.model.timing import Ticks, normalised_time
from gsvrcodec.planes import PACKS
from gsvrcodec.render import render_frames

#: Visits of each frame, by preset.
FRAME_VISITS = {"fastest": 12, "fast": 40, "medium": 100, "slow": 400, "slowest": 1000}
_MIN_STEPS = 100
#: Part of the effort after which the fit sees quantised values.
_QAT_FROM = 0.9


@dataclass(frozen=True, slots=True, eq=False)
class GopTask:
    """What `encode_gop` needs, and nothing else."""

    frames: NDArray[np.uint8]  #: (F, H, W, 3) RGB
    pts: Ticks  #: (F,) ticks
    durations: Ticks  #: (F,) ticks
    first_frame: int  #: number of the first frame in the file
    gaussians: int  #: N
    settings: EncodeSettings
    seconds: float | None  #: wall time to spend; None = by the preset


@dataclass(frozen=True, slots=True, eq=False)
class EncodedGop:
    """A finished GOP."""

    payload: bytes  #: of the GOP chunk
    psnr: float  #: dB, mean of the frames that a decoder will show
    float_psnr: float  #: dB, the same before quantisation


def encode_gop(task: GopTask) -> EncodedGop:
    """Fit, quantise and pack one GOP.

    The same task gives the same bytes in any process and any order, unless it is timed.
    """
    began = time.perf_counter()
    settings, frames = task.settings, task.frames
    taus = normalised_time(task.pts)
    rng = np.random.default_rng([settings.seed, task.first_frame])
    paper = settings.profile == "paper"
    height, width = frames.shape[1:3]
    grid = triplane_grid((width, height), len(frames), settings)
    if paper:
        start = random_start(frames, task.gaussians, grid, rng)
    else:
        flow = None if settings.deform == "triplane" else flow_estimator(settings.flow)
        start = content_aware(frames, taus, task.gaussians, grid, flow, rng)

    field = Field(start, settings.deform)
    bits = BITS[settings.profile]
    steps = max(_MIN_STEPS, FRAME_VISITS[settings.preset] * len(frames))
    seconds = None
    if task.seconds is not None:
        # Packing takes its share too.
        seconds = max(0.1, task.seconds * 0.92 - (time.perf_counter() - began))
    with _single_torch_thread():
        optimise(
            field,
            frames,
            taus,
            PAPER if paper else MAIN,
            Effort(steps, seconds),
            rng,
            quantise=fake_quantiser(bits) if settings.qat else None,
            quantise_from=_QAT_FROM,
            threads=settings.threads,
        )
    gop = field.gop()
    payload = pack_gop(gop, task.pts, task.durations, task.first_frame, bits, PACKS[settings.pack])
    return EncodedGop(
        payload=payload,
        psnr=_quality(dequantised(gop, bits), taus, frames, settings.threads),
        float_psnr=_quality(gop, taus, frames, settings.threads),
    )


@contextmanager
def _single_torch_thread() -> Iterator[None]:
    """Keep torch's own threads from spinning beside the core's."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def _quality(gop: Gop, taus: Float32Array, frames: NDArray[np.uint8], threads: int) -> float:
    """Mean PSNR over the frames, dB."""
    height, width = frames.shape[1:3]
    size = (width, height)
    return fmean(
        psnr(render_frames(gop, tau[None], size, size, threads=threads)[0], frame)
        for tau, frame in zip(taus, frames, strict=True)
    )
