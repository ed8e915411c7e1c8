"""The trainable form of a GOP, and its squared error as one node of torch's graph."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from gsvrcodec.fit.options import Deform
from gsvrcodec.model.attributes import ATTRIBUTES
from gsvrcodec.model.background import together
from gsvrcodec.model.gop import Float32Array, Gop
from gsvrcodec.native import _core
from gsvrcodec.render.native import render_linear

NAMES = Gop.__slots__

_INDICATOR_RANGE = (1e-3, 1 - 1e-3)


class Field:
    """Parameters that an optimiser may change, and the way from them to a `Gop`.

    `raw` holds a leaf tensor for each trained attribute: those of `Gop`, but indicator is a logit.
    What `deform` switches off is not in it. They lie on `device`, "cpu" or "cuda:N". `still`, if
    given, is drawn behind them and never changes.
    """

    def __init__(
        self, start: Gop, deform: Deform, device: str = "cpu", still: Gop | None = None
    ) -> None:
        self.device = device
        self._still = still
        tensors = {
            name: torch.from_numpy(getattr(start, name).astype(np.float32)).to(device)
            for name in NAMES
        }
        self._fixed: dict[str, Tensor] = {}
        if deform == "triplane":
            self._fixed = {
                name: torch.zeros_like(tensors[name])
                for name in ("indicator", "linear", "quadratic")
            }
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

    def tensors(self) -> dict[str, Tensor]:
        """The decoder's parameters, differentiable in `raw`, in the order of `Gop`."""
        out = {**self._fixed, **self.raw}
        if "indicator" in self.raw:
            out["indicator"] = torch.sigmoid(out["indicator"])
        return {name: out[name] for name in NAMES}

    def fix(self, values: Mapping[str, Float32Array]) -> None:
        """Give attributes of `Gop` values that stay as they are: they leave `raw`."""
        for name, value in values.items():
            self.raw.pop(name, None)
            self._fixed[name] = torch.from_numpy(value).to(self.device)

    def uploaded(self, frames: NDArray[np.uint8]) -> NDArray[np.uint8] | Tensor:
        """Frames where they are compared with this field: a tensor if it is on a GPU."""
        if self.device == "cpu":
            return frames
        from gsvrcodec.render.triton import memory_checked

        with memory_checked(f"hold {len(frames)} frames"):
            return torch.from_numpy(frames).to(self.device)

    def backdrop(
        self, size: tuple[int, int], coded_size: tuple[int, int], threads: int = 0
    ) -> Float32Array | Tensor | None:
        """What is drawn behind the trained Gaussians at a size, (H, W, 3); None = nothing.

        Args:
            size: width and height to draw at.
            coded_size: width and height that scales are relative to.
            threads: native threads.
        """
        if self._still is None:
            return None
        picture = render_linear(self._still, 0.0, size, coded_size, threads)
        return picture if self.device == "cpu" else torch.from_numpy(picture).to(self.device)

    def drawn(self) -> Gop:
        """The present state, with what is drawn behind it."""
        gop = self.gop()
        return gop if self._still is None else together(gop, self._still)

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
        tau: float,
        target: NDArray[np.uint8] | Tensor,
        coded_size: tuple[int, int],
        threads: int,
        backdrop: Float32Array | Tensor | None,
        *tensors: Tensor,
    ) -> Tensor:
        inputs = [t.detach() for t in tensors]
        if isinstance(target, Tensor):
            from gsvrcodec.render import triton

            loss, named = triton.squared_error(
                dict(zip(NAMES, inputs, strict=True)),
                torch.full((1,), tau, device=target.device),
                target[None],
                coded_size,
                backdrop if isinstance(backdrop, Tensor) else None,
            )
            ctx.gradients = [named[name] for name in NAMES]
            return loss
        gradients = [torch.empty_like(t) for t in inputs]
        error = _core.squared_error(
            _core.Parameters(*inputs),
            tau,
            target,
            *coded_size,
            _core.Parameters(*gradients),
            threads,
            backdrop,
        )
        ctx.gradients = gradients
        return torch.tensor(error)

    @staticmethod
    def backward(ctx: Any, *outputs: Tensor) -> Any:
        (output,) = outputs
        gradients = ctx.gradients
        torch._foreach_mul_(gradients, output)
        return (None, None, None, None, None, *gradients)


def squared_error(
    tensors: dict[str, Tensor],
    tau: float,
    target: NDArray[np.uint8] | Tensor,
    coded_size: tuple[int, int],
    threads: int = 0,
    backdrop: Float32Array | Tensor | None = None,
) -> Tensor:
    """Mean squared error of the clamped frame at `tau` against `target` (H, W, 3), in [0, 1].

    Render, loss and gradient in one call of the native core, or of the kernels for GPUs if the
    target is a tensor there; the gradient passes through the clamp. The frame is rendered at the
    target's size, in front of `backdrop` (H, W, 3), which lies where the target does.
    """
    result: Tensor = _SquaredError.apply(  # type: ignore[no-untyped-call]
        tau, target, coded_size, threads, backdrop, *tensors.values()
    )
    return result


def adam_step(
    leaf: Tensor,
    mean: Tensor,
    square: Tensor,
    rates: Tensor,
    factor: float,
    betas: tuple[float, float],
    epsilon: float,
    step: int,
    threads: int = 0,
) -> None:
    """One step of Adam in place, where the tensors are.

    Args:
        leaf: what is optimised, with its gradient.
        mean: first moment.
        square: second moment.
        rates: learning rate of each component of the last axis.
        factor: of all rates.
        betas: decay of the two moments.
        epsilon: added to the root of the second moment.
        step: number of this step, from 1.
        threads: native threads.
    """
    value, gradient = leaf.detach(), leaf.grad
    if leaf.is_cuda:
        from gsvrcodec.render import triton

        assert gradient is not None
        triton.adam_step(
            value, gradient.contiguous(), mean, square, rates, factor, betas, epsilon, step
        )
    else:
        _core.adam_step(
            value, gradient, mean, square, rates * factor, *betas, epsilon, step, threads
        )
