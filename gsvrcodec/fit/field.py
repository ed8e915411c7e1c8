"""The trainable form of a GOP, and its squared error as one node of torch's graph."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from torch import Tensor

from gsvrcodec.fit.options import Deform
from gsvrcodec.model.attributes import ATTRIBUTES
from gsvrcodec.model.static import append_gaussians
from gsvrcodec.model.gop import Float32Array, Gop
from gsvrcodec.render.backend import Backend, Samples

NAMES = Gop.__slots__
Tensors = dict[str, Tensor]  #: parameters by the names of `Gop`

_INDICATOR_RANGE = (1e-3, 1 - 1e-3)


class Field:
    """Parameters that an optimiser may change, and the way from them to a `Gop`.

    `raw` holds one leaf tensor for each trained attribute, by the names of `Gop`; the indicator is
    a logit there. Attributes that `deform` switches off are not in `raw`.

    Args:
        start: the state to begin with; copied.
        deform: parts of the deformation field in use.
        backend: the renderer, on whose device the tensors lie.
        background: static Gaussians that are drawn behind the field and never change.
    """

    def __init__(
        self, start: Gop, deform: Deform, backend: Backend, background: Gop | None = None
    ) -> None:
        self.backend = backend
        self._background = background
        device = backend.device
        tensors = {
            name: torch.from_numpy(getattr(start, name).astype(np.float32)).to(device)
            for name in NAMES
        }
        self._fixed: dict[str, Tensor] = {}
        if deform == "triplane":
            names = ("indicator", "linear", "quadratic")
            self._fixed = {name: torch.zeros_like(tensors[name]) for name in names}
        elif deform == "polynomial":
            self._fixed = {
                "indicator": torch.ones_like(tensors["indicator"]),
                **{name: torch.zeros(0, 0, 8, device=device) for name in ("xy", "xt", "yt")},
            }
        self.raw = {
            name: tensor.requires_grad_()
            for name, tensor in tensors.items()
            if name not in self._fixed
        }
        if "indicator" in self.raw:
            indicator = tensors["indicator"].detach().clamp(*_INDICATOR_RANGE)
            self.raw["indicator"] = torch.logit(indicator).requires_grad_()

    def tensors(self) -> Tensors:
        """The decoder's parameters, differentiable in `raw`, in the order of `Gop`."""
        out = {**self._fixed, **self.raw}
        if "indicator" in self.raw:
            out["indicator"] = torch.sigmoid(out["indicator"])
        return {name: out[name] for name in NAMES}

    def fix(self, values: Mapping[str, Float32Array]) -> None:
        """Give attributes of `Gop` values that stay as they are: they leave `raw`."""
        for name, value in values.items():
            self.raw.pop(name, None)
            self._fixed[name] = torch.from_numpy(value).to(self.backend.device)

    def backdrop(self, size: tuple[int, int], coded_size: tuple[int, int]) -> Samples | None:
        """The background rendered at a size, (H, W, 3), where the backend adds it; None = none.

        Args:
            size: width and height to draw at.
            coded_size: width and height that scales are relative to.
        """
        if self._background is None:
            return None
        prepared = self.backend.prepare(self._background)
        return self.backend.upload(self.backend.picture(prepared, 0.0, size, coded_size))

    def drawn(self) -> Gop:
        """The present state together with the background."""
        gop = self.gop()
        return gop if self._background is None else append_gaussians(gop, self._background)

    def gop(self) -> Gop:
        """The present state, as arrays of its own, well within the bounds of the spec."""
        tensors = self.tensors()
        return Gop(
            **{
                a.name: np.clip(tensors[a.name].numpy(force=True), 0.99 * a.low, 0.99 * a.high)
                for a in ATTRIBUTES
            }
        )


class _SquaredError(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any,
        backend: Backend,
        tau: float,
        target: Samples,
        coded_size: tuple[int, int],
        backdrop: Samples | None,
        *tensors: Tensor,
    ) -> Tensor:
        parameters = {name: t.detach() for name, t in zip(NAMES, tensors, strict=True)}
        error, gradients = backend.squared_error(parameters, tau, target, coded_size, backdrop)
        ctx.gradients = gradients
        return error if isinstance(error, Tensor) else torch.tensor(error)

    @staticmethod
    def backward(ctx: Any, *outputs: Tensor) -> Any:
        (output,) = outputs
        gradients = ctx.gradients
        torch._foreach_mul_(gradients, output)
        return (None, None, None, None, None, *gradients)


def squared_error(
    backend: Backend,
    tensors: Mapping[str, Tensor],
    tau: float,
    target: Samples,
    coded_size: tuple[int, int],
    backdrop: Samples | None = None,
) -> Tensor:
    """Mean squared error of the clamped frame at `tau` against `target` (H, W, 3), in [0, 1].

    The backend renders, compares and differentiates in one call; the gradient passes through the
    clamp. The frame is rendered at the target's size, in front of `backdrop` (H, W, 3).
    """
    result: Tensor = _SquaredError.apply(  # type: ignore[no-untyped-call]
        backend, tau, target, coded_size, backdrop, *tensors.values()
    )
    return result
