"""Pictures and jobs that the tests of fitting share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch

from gsvrcodec.bitstream.gop_payload import GopContent, unpack_gop
from gsvrcodec.bitstream.header import IMAGE_CODECS_FLAG, Header
from gsvrcodec.encoder.job import GopJob
from gsvrcodec.encoder.plan import Budget
from gsvrcodec.encoder.results import EncodedGop
from gsvrcodec.encoder.settings import EncodeSettings
from gsvrcodec.fit.footage import Footage, Frames
from gsvrcodec.fit.parameters import Parameters
from gsvrcodec.limits import Limits
from gsvrcodec.model.gop import Float32Array, Gop
from gsvrcodec.model.time import normalised_time
from gsvrcodec.render import render_frames
from gsvrcodec.render.native import NativeBackend
from gsvrcodec.render.reference import render
from gsvrcodec.video import open_video
from tests import making

BACKEND = NativeBackend()

#: Frames in each of the short sample clips.
FRAMES = {
    making.BUNNY_SMALL: 24,
    making.TEN_BIT: 12,
    making.ODD: 24,
    making.VFR_ROTATED: 16,
    making.NOISE: 20,
}


def moving_texture(
    frames: int, step: tuple[float, float], size: tuple[int, int] = (160, 120)
) -> Frames:
    """Return smooth noise that moves by `step` (x, y) pixels a frame."""
    width, height = size
    noise = np.random.default_rng(3).integers(0, 256, (height + 80, width + 80, 3), np.uint8)
    smooth = cv2.GaussianBlur(noise, (0, 0), 2).astype(np.float32)
    texture = (smooth - smooth.min()) * (255 / np.ptp(smooth))
    shots = []
    for number in range(frames):
        x, y = (40 - step[0] * number, 40 - step[1] * number)
        matrix = np.array([[1, 0, -x], [0, 1, -y]], np.float32)
        shots.append(cv2.warpAffine(texture, matrix, size, flags=cv2.INTER_LINEAR))
    return np.stack(shots).round().astype(np.uint8)


@cache
def sample(path: Path, crop: tuple[int, int] | None = None, frames: int | None = None) -> Frames:
    """Return frames of a sample clip, cropped to (width, height) around its centre."""
    with open_video(path, None if crop is None else (*crop, None, None), 0, frames) as video:
        shots = np.stack([shot.rgb for shot in video])
    shots.flags.writeable = False
    return shots


def gop_job(
    frames: Frames,
    budget: Budget | int = 100,
    *,
    first_frame: int = 0,
    seconds: float | None = None,
    **settings: Any,
) -> GopJob:
    """Return what `encode_gop` needs; the least effort unless settings say otherwise."""
    chosen = replace(EncodeSettings(preset="fastest"), **settings)
    return GopJob(
        frames=frames,
        pts=512 * np.arange(first_frame, first_frame + len(frames), dtype=np.int64),
        durations=np.full(len(frames), 512, np.int64),
        first_frame=first_frame,
        budget=Budget(budget) if isinstance(budget, int) else budget,
        settings=chosen,
        seconds=seconds,
    )


def unpacked(done: EncodedGop, job: GopJob) -> GopContent:
    """Return what a decoder reads."""
    height, width = job.frames.shape[1:3]
    header = Header(
        width=width,
        height=height,
        time_base=Fraction(1, 12800),
        max_gaussians=10**6,
        max_gop_frames=len(job.frames),
        max_grid=(64, 64, 64),
        flags_optional=IMAGE_CODECS_FLAG,
        blending=job.settings.blending,
    )
    return unpack_gop(done.payload, header, Limits())


def decoded(done: EncodedGop, job: GopJob) -> Gop:
    """Return the Gaussians that a decoder draws."""
    reference = job.reference
    content = unpacked(done, job)
    return content.gop(reference.gop, reference.frames) if reference else content.gop(None, 0)


def quality(gop: Gop, job: GopJob) -> float:
    """Return the mean PSNR of what a decoder shows, dB."""
    blending = job.settings.blending
    shown = render_frames(gop, normalised_time(job.pts), job.size, job.size, blending=blending)
    return float(np.mean([making.psnr(*pair) for pair in zip(job.frames, shown, strict=True)]))


def times(frames: int) -> Float32Array:
    """Return the normalised times of evenly spaced frames."""
    return np.linspace(-1, 1, frames, dtype=np.float32) if frames > 1 else np.zeros(1, np.float32)


def footage(frames: Frames, background: Gop | None = None) -> Footage:
    """Return evenly spaced frames, to be fitted in front of static Gaussians."""
    return Footage(frames, times(len(frames)), background)


def assert_finite(gop: Gop) -> None:
    """Every number is one."""
    for parameters in fields(Gop):
        assert np.isfinite(getattr(gop, parameters.name)).all(), parameters.name


def assert_gradients_of_the_reference(
    parameters: Parameters,
    exact: Mapping[str, torch.Tensor],
    leaves: Mapping[str, torch.Tensor],
    tau: float,
    picture: Frames,
    coded_size: tuple[int, int],
) -> None:
    """Error against a picture (h, w, 3) and gradients are the float64 renderer's.

    `exact` are the decoder's parameters in binary64, computed from `leaves`, which are those of
    `parameters.raw`.
    """
    size = picture.shape[1], picture.shape[0]
    frame = render(exact, tau, size, coded_size)
    shown = frame + (frame.clamp(0, 1) - frame).detach()  # the gradient passes the clamp
    reference = (shown - torch.from_numpy(picture) / 255).square().mean()
    theirs = torch.autograd.grad(reference, list(leaves.values()))

    error, _ = BACKEND.squared_error(parameters.tensors(), tau, picture, coded_size)
    assert error == pytest.approx(reference.item(), rel=1e-4)
    ours = parameters.gradients(parameters.tensors(), tau, picture, coded_size)
    assert ours.keys() == parameters.raw.keys()
    for (name, one), other in zip(ours.items(), theirs, strict=True):
        missed = (torch.from_numpy(one) - other).norm() / other.norm().clamp(min=1e-12)
        assert missed < 1e-3, name
