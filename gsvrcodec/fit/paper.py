"""The method as published: start, rates and quantisation."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from gsvrcodec.fit.fitting import Allowance, Fit, mean_psnr
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
from gsvrcodec.render.backend import AdamRule, Backend, Tensor

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
        quantise=fake_quantiser(PAPER_BITS, backend.xp) if options.tune else None,
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


def fake_quantiser(bits: Mapping[str, int], xp: Any) -> Callable[[Tensors], Tensors]:
    """Quantisation of each component over its range.

    The values agree with `gsvrcodec.model.quantise.dequantised` but for rounding. Their gradients
    count as those of the values before (a straight-through estimate).

    Args:
        bits: of each attribute; others stay as they are.
        xp: library of the tensors, see `Backend`.
    """

    def quantise(tensors: Tensors) -> Tensors:
        out = {}
        for name, values in tensors.items():
            if name == "rotation":  # pi-periodic, and stored in [0, pi)
                values = values - xp.floor(values / math.pi) * math.pi
            stored = name in bits and 0 not in values.shape
            out[name] = _over_range(values, bits[name], xp) if stored else values
        return out

    return quantise


def _over_range(values: Tensor, bits: int, xp: Any) -> Tensor:
    """Round to the steps of a file that span the values of each component; see `Quantiser.fit`."""
    columns = values.reshape(-1, values.shape[-1] if values.ndim > 1 else 1)
    low, high = (xp.asarray(end(columns, 0), dtype=xp.float64) for end in (xp.amin, xp.amax))
    span = (high - low) / max((1 << bits) - 2, 1)
    finest = xp.maximum(-low, high) / MOST_MULTIPLE
    fraction, exponent = xp.frexp(xp.clip(xp.maximum(span, finest), LEAST_VALUE, None))
    step = xp.ldexp(xp.ceil(fraction * 2**STEP_DIGITS), exponent - STEP_DIGITS)
    first = xp.floor(low / step)
    codes = xp.clip(xp.round(columns / step - first), 0, (1 << bits) - 1)
    return xp.asarray((codes + first) * step, dtype=values.dtype).reshape(values.shape)


def as_published(fit: Fit, backend: Backend) -> Quantised:
    """Return a fit with the publication's bits over the range of each attribute."""
    psnr = mean_psnr(dequantised(fit.gop, PAPER_BITS), fit.footage, backend)
    return Quantised(fit.gop, PAPER_BITS, psnr, None)
