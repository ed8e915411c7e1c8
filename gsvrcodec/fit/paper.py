"""The method as published: start, rates and quantisation."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping

import numpy as np
import torch
from torch import Tensor

from gsvrcodec.fit.fitting import Allowance, Fit, mean_psnr, single_torch_thread
from gsvrcodec.fit.footage import Footage, Frames
from gsvrcodec.fit.optimise import optimise
from gsvrcodec.fit.parameters import Parameters, Tensors
from gsvrcodec.fit.quantise import Quantised
from gsvrcodec.fit.recipe import FitOptions, Recipe, cosine
from gsvrcodec.fit.start import tri_plane
from gsvrcodec.fit.tuned import EFFORT
from gsvrcodec.model.gop import Float32Array, Gop, GridSize
from gsvrcodec.model.quantise import (
    LEAST_VALUE,
    MOST_MULTIPLE,
    PAPER_BITS,
    STEP_DIGITS,
    dequantised,
)
from gsvrcodec.render.backend import AdamRule, Backend

#: The publication's rates; no coarse stage.
PAPER = Recipe(
    rates={
        **dict.fromkeys(("position", "log_scale", "rotation", "colour", "log_opacity"), 0.01),
        **dict.fromkeys(("indicator", "linear", "quadratic", "xy", "xt", "yt"), 0.0025),
    },
    in_pixels=False,
    rated_steps=math.inf,
    rule=AdamRule((0.9, 0.999)),
    decay=cosine,
    warm_up=1,
    coarse=0.0,
    relocations=(),
    ends=False,
)


@single_torch_thread()
def fit_as_published(
    footage: Footage,
    gaussians: int,
    grid: GridSize,
    options: FitOptions,
    allowance: Allowance,
    backend: Backend,
    *,
    seed: tuple[int, ...],
) -> Fit:
    """Fit Gaussians to frames by the publication; arguments as of `fit_gop`."""
    began = time.perf_counter()
    rng = np.random.default_rng(seed)
    parameters = Parameters(
        random_start(footage.frames, gaussians, grid, rng), options.deform, backend
    )
    effort, _ = allowance.split(tune=False, least_steps=EFFORT.least_steps, began=began)
    optimise(
        parameters,
        footage,
        PAPER,
        effort,
        rng,
        quantise=fake_quantiser(PAPER_BITS) if options.tune else None,
        quantise_from=EFFORT.qat_from,
    )
    gop = parameters.gop()
    return Fit(gop, mean_psnr(gop, footage, backend), effort.expected_steps, None, footage)


def random_start(frames: Frames, gaussians: int, grid: GridSize, rng: np.random.Generator) -> Gop:
    """Start as the paper does: anywhere, at rest, in any colour."""
    height, width = frames.shape[1:3]
    spacing = np.float32(np.sqrt(width * height / gaussians))

    def uniform(low: float, high: float, *shape: int) -> Float32Array:
        return rng.uniform(low, high, shape).astype(np.float32)

    return Gop(
        position=uniform(-1, 1, gaussians, 2),
        log_scale=np.log(spacing * uniform(0.25, 1.0, gaussians, 2)),
        rotation=uniform(0, np.pi, gaussians),
        colour=uniform(0, 0.5, gaussians, 3),
        log_opacity=np.zeros(gaussians, np.float32),
        indicator=np.full(gaussians, 0.5, np.float32),
        linear=np.zeros((gaussians, 2), np.float32),
        quadratic=np.zeros((gaussians, 2), np.float32),
        **dict(zip(("xy", "xt", "yt"), tri_plane(grid, rng), strict=True)),
    )


def fake_quantiser(bits: Mapping[str, int]) -> Callable[[Tensors], Tensors]:
    """Quantisation of each component over its range.

    The values agree with `gsvrcodec.model.quantise.dequantised` but for rounding. Their gradients
    count as those of the values before (a straight-through estimate).

    Args:
        bits: of each attribute; others stay as they are.
    """

    def quantise(tensors: Tensors) -> Tensors:
        out = {}
        for name, values in tensors.items():
            if name == "rotation":  # pi-periodic, and stored in [0, pi)
                values = values - (values / math.pi).floor() * math.pi
            stored = name in bits and values.numel()
            out[name] = _over_range(values, bits[name]) if stored else values
        return out

    return quantise


def _over_range(values: Tensor, bits: int) -> Tensor:
    """Round to the steps of a file that span the values of each component; see `Quantiser.fit`."""
    columns = values.reshape(len(values), -1) if values.dim() < 3 else values.flatten(0, 1)
    low, high = (end.double() for end in torch.aminmax(columns, dim=0))
    span = (high - low) / max((1 << bits) - 2, 1)
    finest = torch.maximum(-low, high) / MOST_MULTIPLE
    fraction, exponent = torch.frexp(torch.maximum(span, finest).clamp(min=LEAST_VALUE))
    step = torch.ldexp((fraction * 2**STEP_DIGITS).ceil(), exponent - STEP_DIGITS)
    first = (low / step).floor()
    codes = (columns / step - first).round_().clamp_(0, (1 << bits) - 1)
    return codes.add_(first).mul_(step).to(values.dtype).view_as(values)


def as_published(fit: Fit, backend: Backend) -> Quantised:
    """Return a fit with the publication's bits over the range of each attribute."""
    psnr = mean_psnr(dequantised(fit.gop, PAPER_BITS), fit.footage, backend)
    return Quantised(fit.gop, PAPER_BITS, psnr, None)
