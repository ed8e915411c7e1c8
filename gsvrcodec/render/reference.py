"""The equations of spec/gsvr.md, section "Reconstruction", in plain differentiable torch.

Slow on purpose: each Gaussian is evaluated at each pixel, in whatever dtype the parameters have
(float64 in the tests). Every other backend is compared with this one, in value and gradient.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from gsvrcodec.model.gop import Float32Array, Gop
from gsvrcodec.model.pyramid import level_of, level_size, zoom
from gsvrcodec.model.reconstruction import (
    ANTIALIAS,
    CUTOFF,
    DILATION,
    GROUND,
    LEVELS,
    MIN_SCALE,
    MIN_VARIANCE,
    MOST_LOG_OPACITY,
    UPSAMPLING,
    Blending,
)
from gsvrcodec.render.backend import TILE, AdamPart, AdamRule, Backend, Codes, Samples, Scalar, Size

_CHUNK = 256  # Gaussians evaluated at once: bounds the memory


class Splats(NamedTuple):
    """Gaussians at one time, each on its level of a frame's pyramid."""

    centre: Tensor  #: (N, 2) px of the level
    covariance: Tensor  #: (N, 2, 2) px^2 of the level
    factors: Tensor  #: (N, 4) of the weight: of the colours, and of the weight itself
    level: Tensor  #: (N,) integers


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
    parameters: Mapping[str, Tensor],
    tau: float,
    size: tuple[int, int],
    coded_size: tuple[int, int],
    blending: Blending = "mean",
) -> Splats:
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
    offset = (1 - parameters["indicator"])[:, None] * offset
    mu = position + parameters["linear"] * tau + parameters["quadratic"] * tau**2 + offset[:, 0:2]
    theta = parameters["rotation"] + offset[:, 4]
    cos, sin = theta.cos(), theta.sin()
    rotation = torch.stack([torch.stack([cos, -sin], 1), torch.stack([sin, cos], 1)], 1)

    least = zoom(size, coded_size)
    log_scale = parameters["log_scale"]
    level = torch.from_numpy(level_of(log_scale.detach().float().numpy(), least))
    scale = (log_scale.exp() + offset[:, 2:4]).clamp(min=MIN_SCALE)
    # One px^2 of each Gaussian's level, in px^2 of the coded frame.
    area = (4.0**level / least**2)[:, None]
    above = (level > 0)[:, None]
    widening = torch.where(above, -UPSAMPLING * area, DILATION + ANTIALIAS * max(least**-2 - 1, 0))
    variance = torch.maximum(scale**2 + widening, torch.where(above, MIN_VARIANCE * area, 0.0))
    amplitude = ((scale**2 + DILATION) / variance).prod(dim=1, keepdim=True).sqrt()
    covariance = rotation @ torch.diag_embed(variance) @ rotation.mT
    colour, opacity = parameters["colour"], torch.ones_like(amplitude)
    if blending == "sum":
        colour = colour + offset[:, 5:8]
    else:
        log_opacity = (parameters["log_opacity"] + offset[:, 5])[:, None]
        opacity = log_opacity.clamp(-MOST_LOG_OPACITY, MOST_LOG_OPACITY).exp()
    pixels = position.new_tensor(size) / 2.0 ** level[:, None]
    unit = pixels / position.new_tensor(coded_size)
    return Splats(
        centre=(mu + 1) / 2 * pixels,
        covariance=covariance * unit[:, :, None] * unit[:, None, :],
        factors=amplitude * opacity * torch.cat([colour, torch.ones_like(amplitude)], 1),
        level=level,
    )


def rasterise(splats: Splats, level: int, size: tuple[int, int]) -> Tensor:
    """Sums over the Gaussians of one level, (H, W, 4); `size` (W, H) is the level's."""
    width, height = size
    own = splats.level == level
    centre, factors = splats.centre[own], splats.factors[own]
    inverse = torch.linalg.inv(splats.covariance[own])
    dtype = centre.dtype
    x = torch.arange(width, dtype=dtype) + 0.5
    y = torch.arange(height, dtype=dtype) + 0.5
    picture = torch.zeros(height, width, 4, dtype=dtype)
    for begin in range(0, len(centre), _CHUNK):
        part = slice(begin, begin + _CHUNK)
        dx = (x - centre[part, :1])[:, None, :]
        dy = (y - centre[part, 1:])[:, :, None]
        a, b, c = (inverse[part, i, j, None, None] for i, j in ((0, 0), (0, 1), (1, 1)))
        exponent = (a * dx * dx + 2 * b * dx * dy + c * dy * dy) / 2
        weight = (torch.exp(-exponent) - CUTOFF).clamp(min=0)
        picture = picture + torch.einsum("nhw,nc->hwc", weight, factors[part])
    return picture


def upsample(picture: Tensor, size: tuple[int, int]) -> Tensor:
    """Double the sides of a level (h, w, 4), bilinearly, and crop it to `size` (W, H)."""
    double = torch.nn.functional.interpolate(
        picture.permute(2, 0, 1)[None], scale_factor=2, mode="bilinear", align_corners=False
    )
    return double[0, :, : size[1], : size[0]].permute(1, 2, 0)


def render_sums(
    parameters: Mapping[str, Tensor],
    tau: float,
    size: tuple[int, int],
    coded_size: tuple[int, int],
    blending: Blending = "mean",
) -> Tensor:
    """Sums of weighted colours and of weights, (H, W, 4)."""
    splats = deform(parameters, tau, size, coded_size, blending)
    sums = rasterise(splats, LEVELS - 1, level_size(size, LEVELS - 1))
    for level in reversed(range(LEVELS - 1)):
        below = level_size(size, level)
        sums = upsample(sums, below) + rasterise(splats, level, below)
    return sums


def render(
    parameters: Mapping[str, Tensor],
    tau: float,
    size: tuple[int, int],
    coded_size: tuple[int, int] | None = None,
    blending: Blending = "mean",
    backdrop: Tensor | None = None,
) -> Tensor:
    """Render one frame, (H, W, 3), neither clamped nor rounded; differentiable in `parameters`.

    The sums (H, W, 4) of a backdrop are added to those of the frame.
    """
    sums = render_sums(parameters, tau, size, coded_size or size, blending)
    if backdrop is not None:
        sums = sums + backdrop
    return sums[..., :3] if blending == "sum" else sums[..., :3] / (sums[..., 3:] + GROUND)


class ReferenceBackend(Backend):
    """The equations in float64, on the CPU; slow."""

    device, xp = "cpu", torch
    skips_tiles = True

    def __init__(self, blending: Blending = "mean") -> None:
        """Form pictures so."""
        self.blending = blending

    def prepare(self, gop: Gop) -> dict[str, Tensor]:
        """Return the parameters in float64."""
        return {
            name: torch.tensor(getattr(gop, name), dtype=torch.float64) for name in Gop.__slots__
        }

    def render(
        self,
        prepared: Mapping[str, Tensor],
        taus: Float32Array,
        size: Size,
        coded_size: Size,
        *,
        bit_depth: int = 8,
        out: Codes | None = None,
    ) -> Codes:
        """Render frames of a prepared GOP."""
        white = 2**bit_depth - 1
        frames = [
            (picture.clamp(0, 1) * white + 0.5).floor()
            for tau in taus
            for picture in [self._rendered(prepared, float(tau), size, coded_size)]
        ]
        values: NDArray[np.float64] = torch.stack(frames).numpy()
        codes = values.astype(np.uint8) if bit_depth == 8 else values.astype(np.uint16)
        if out is None:
            return codes
        np.copyto(out, codes)
        return out

    def picture(
        self, prepared: Mapping[str, Tensor], tau: float, size: Size, coded_size: Size
    ) -> Float32Array:
        """Render one frame, (H, W, 3), neither clamped nor rounded."""
        samples: Float32Array = self._rendered(prepared, tau, size, coded_size).float().numpy()
        return samples

    def _rendered(
        self, parameters: Mapping[str, Tensor], tau: float, size: Size, coded_size: Size
    ) -> Tensor:
        return render(parameters, tau, size, coded_size, self.blending, self._behind(size))

    def _behind(self, size: Size, backdrop: Samples | None = None) -> Tensor | None:
        """What lies behind a frame, (H, W, 4)."""
        found = self.behind(size, backdrop)
        return None if found is None else torch.from_numpy(found)

    def sums(
        self, prepared: Mapping[str, Tensor], tau: float, size: Size, coded_size: Size
    ) -> Float32Array:
        """Return the sums that a frame is made of, (H, W, 4)."""
        sums, behind = (
            render_sums(prepared, tau, size, coded_size, self.blending),
            self._behind(size),
        )
        if behind is not None:
            sums = sums + behind
        samples: Float32Array = sums.float().numpy()
        return samples

    def gradient(
        self,
        gop: Gop,
        tau: float,
        weights: Float32Array,
        coded_size: Size,
        backdrop: Samples | None = None,
    ) -> Gop:
        """Return the gradient of sum(weights * picture) in place of each parameter."""
        size = weights.shape[1], weights.shape[0]
        leaves = _leaves(self.prepare(gop))
        behind = self._behind(size, backdrop)
        picture = render(leaves, tau, size, coded_size, self.blending, behind)
        total = (picture * torch.from_numpy(weights)).sum()
        gradients = _gradients(total, leaves)
        return Gop(**{name: g.float().numpy() for name, g in zip(leaves, gradients, strict=True)})

    def squared_error(
        self,
        parameters: Mapping[str, Tensor],
        tau: Scalar,
        target: Samples,
        coded_size: Size,
        backdrop: Samples | None = None,
        weights: Float32Array | None = None,
    ) -> tuple[float, Sequence[Tensor]]:
        """Return the mean squared error of one clamped frame and its gradients."""
        leaves = _leaves(parameters)
        size = target.shape[1], target.shape[0]
        behind = self._behind(size, backdrop)
        picture = render(leaves, tau, size, coded_size, self.blending, behind)
        shown = picture + (picture.clamp(0, 1) - picture).detach()
        squares = (shown - torch.from_numpy(target) / 255).square()
        if weights is not None:
            across, down = TILE
            each = torch.from_numpy(weights).repeat_interleave(down, 0).repeat_interleave(across, 1)
            squares = squares * each[: size[1], : size[0], None]
        error = squares.mean()
        gradients = _gradients(error, leaves)
        return error.item(), [
            gradient.to(values.dtype)
            for gradient, values in zip(gradients, parameters.values(), strict=True)
        ]

    def hold(self, values: NDArray[Any]) -> Tensor:
        """Return a tensor of the same memory."""
        return torch.from_numpy(values)

    def fetch(self, values: Tensor) -> NDArray[Any]:
        """Return an array of the same memory."""
        array: NDArray[Any] = values.numpy(force=True)
        return array

    def adam_step(
        self,
        parts: Sequence[AdamPart],
        gradients: Sequence[Tensor],
        rule: AdamRule,
        factor: Scalar,
        step: Scalar,
    ) -> None:
        """Take one step of Adam in place."""
        beta1, beta2 = rule.betas
        for part, slope in zip(parts, gradients, strict=True):
            gradient = slope if part.axes is None else (slope[:, None] @ part.axes)[:, 0]
            part.mean.mul_(beta1).add_((1 - beta1) * gradient)
            part.square.mul_(beta2).add_((1 - beta2) * gradient.square())
            root = (part.square / (1 - beta2**step)).sqrt() + rule.epsilon
            agrees = part.mean * gradient > 0
            step_back = factor * part.rates * part.mean / (1 - beta1**step) / root
            step_back = step_back * torch.where(agrees, rule.agreeing, rule.opposing)
            if part.pace is not None:
                step_back = step_back * part.pace
            if part.axes is not None:
                step_back = (part.axes @ step_back[:, :, None])[:, :, 0]
            part.value.sub_(step_back)


def _leaves(parameters: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Copies in float64 whose gradients are wanted."""
    return {name: value.detach().double().requires_grad_() for name, value in parameters.items()}


def _gradients(total: Tensor, leaves: Mapping[str, Tensor]) -> list[Tensor]:
    """Gradients of a sum; zeros for what it does not depend on."""
    values = list(leaves.values())
    if not total.requires_grad:
        return [torch.zeros_like(value) for value in values]
    gradients = torch.autograd.grad(total, values, allow_unused=True, materialize_grads=True)
    # In torch 2.8, the zeros for what is empty ask for gradients of their own.
    return [gradient.detach() for gradient in gradients]
