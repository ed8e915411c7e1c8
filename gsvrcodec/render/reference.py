"""The equations of spec/gsvr.md, section "Reconstruction", in plain differentiable torch.

Slow on purpose: each Gaussian is evaluated at each pixel, in whatever dtype the parameters have
(float64 in the tests). Every other backend is compared with this one, in value and gradient.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from gsvrcodec.model.gop import Float32Array, Gop

MIN_SCALE = 0.1  #: px of the coded frame
DILATION = 0.1  #: px^2 of the coded frame
CUTOFF = 1.0 / 255.0

_CHUNK = 256  # Gaussians evaluated at once: bounds the memory


class Deformed(NamedTuple):
    """Gaussians at one time, on a frame of `size`."""

    centre: Tensor  #: (N, 2) px
    covariance: Tensor  #: (N, 2, 2) px^2
    colour: Tensor  #: (N, 3)


def _bilinear(grid: Tensor, x: Tensor, y: Tensor) -> Tensor:
    """Look up `grid` (rows, columns, C) at x, y (N,) in [-1, 1]: aligned corners, border clamp."""
    rows, columns, _ = grid.shape

    def cell(position: Tensor, size: int) -> tuple[Tensor, Tensor, Tensor]:
        u = ((position + 1) / 2 * (size - 1)).clamp(0, size - 1)
        low = u.detach().floor().long()
        return low, (low + 1).clamp(max=size - 1), (u - low)[:, None]

    x0, x1, fx = cell(x, columns)
    y0, y1, fy = cell(y, rows)
    top = grid[y0, x0] * (1 - fx) + grid[y0, x1] * fx
    bottom = grid[y1, x0] * (1 - fx) + grid[y1, x1] * fx
    return top * (1 - fy) + bottom * fy


def deform(
    parameters: Mapping[str, Tensor], tau: float, size: tuple[int, int], coded_size: tuple[int, int]
) -> Deformed:
    """Deform the canonical Gaussians to time `tau` and project them to a frame of `size` (W, H).

    `parameters` holds the fields of `gsvrcodec.model.gop.Gop` as tensors of one dtype.
    """
    position = parameters["position"]
    x, y = position.unbind(1)
    offset = position.new_zeros(len(position), 8)
    if parameters["xy"].numel():
        time = torch.full_like(x, tau)
        offset = (
            _bilinear(parameters["xy"], x, y)
            * _bilinear(parameters["xt"], x, time)
            * _bilinear(parameters["yt"], y, time)
        )
    gate = (1 - parameters["alpha"])[:, None]
    mu = (
        position
        + parameters["linear"] * tau
        + parameters["quadratic"] * tau**2
        + gate * offset[:, 0:2]
    )
    scale = (parameters["log_scale"].exp() + offset[:, 2:4]).clamp(min=MIN_SCALE)
    theta = parameters["rotation"] + offset[:, 4]
    cos, sin = theta.cos(), theta.sin()
    rotation = torch.stack([torch.stack([cos, -sin], 1), torch.stack([sin, cos], 1)], 1)
    covariance = rotation @ torch.diag_embed(scale**2) @ rotation.mT
    covariance = covariance + DILATION * torch.eye(2, dtype=position.dtype)
    zoom = position.new_tensor([size[0] / coded_size[0], size[1] / coded_size[1]])
    return Deformed(
        centre=(mu + 1) / 2 * position.new_tensor(size),
        covariance=covariance * zoom[:, None] * zoom[None, :],
        colour=parameters["colour"] + offset[:, 5:8],
    )


def render(
    parameters: Mapping[str, Tensor],
    tau: float,
    size: tuple[int, int],
    coded_size: tuple[int, int] | None = None,
) -> Tensor:
    """Render one frame, (H, W, 3), neither clamped nor rounded; differentiable in `parameters`."""
    width, height = size
    splats = deform(parameters, tau, size, coded_size or size)
    inverse = torch.linalg.inv(splats.covariance)
    dtype = splats.centre.dtype
    x = torch.arange(width, dtype=dtype) + 0.5
    y = torch.arange(height, dtype=dtype) + 0.5
    frame = torch.zeros(height, width, 3, dtype=dtype)
    for begin in range(0, len(splats.centre), _CHUNK):
        part = slice(begin, begin + _CHUNK)
        dx = (x - splats.centre[part, :1])[:, None, :]
        dy = (y - splats.centre[part, 1:])[:, :, None]
        a, b, c = (inverse[part, i, j, None, None] for i, j in ((0, 0), (0, 1), (1, 1)))
        exponent = (a * dx * dx + 2 * b * dx * dy + c * dy * dy) / 2
        weight = (torch.exp(-exponent) - CUTOFF).clamp(min=0)
        frame = frame + torch.einsum("nhw,nc->hwc", weight, splats.colour[part])
    return frame


def render_frames(
    gop: Gop, taus: Float32Array, size: tuple[int, int], coded_size: tuple[int, int]
) -> NDArray[np.uint8]:
    """Render frames of one GOP in float64; see `gsvrcodec.render.render_frames`."""
    parameters = {
        name: torch.tensor(getattr(gop, name), dtype=torch.float64) for name in Gop.__slots__
    }
    frames = [
        (render(parameters, float(tau), size, coded_size).clamp(0, 1) * 255 + 0.5).floor()
        for tau in taus
    ]
    return torch.stack(frames).to(torch.uint8).numpy()
