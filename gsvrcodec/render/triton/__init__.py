"""The backend for GPUs: Triton kernels over torch tensors, many frames of a GOP in one launch.

Needs CUDA (or ROCm, which is not tested), or TRITON_INTERPRET=1 to run on the CPU, slowly.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
import torch
import triton
from numpy.typing import NDArray
from torch import Tensor

from gsvrcodec.errors import DeviceError
from gsvrcodec.model.gop import Float32Array, Gop
from gsvrcodec.model.reconstruction import Blending
from gsvrcodec.render.backend import AdamPart, AdamRule, Backend, Samples, Scalar, Size
from gsvrcodec.render.triton.adam import NUMBERS, adam_update
from gsvrcodec.render.triton.launch import Parameters, Pass, on_device, scratch_bytes
from gsvrcodec.render.triton.record import Recorded, Recorder

#: Scratch memory that frames rendered together may take.
_PASS_BYTES = 2**30
#: Tiles to a side of a frame, by which Gaussians are ordered.
_TILES = 40
_GRIDS = ("xy", "xt", "yt")


@contextmanager
def memory_checked(what: str) -> Iterator[None]:
    """Say what to change when the device's memory does not suffice for `what`."""
    try:
        yield
    except torch.OutOfMemoryError as error:
        raise DeviceError(
            f"the memory of the GPU does not suffice to {what}; free some of it, use smaller "
            "pictures, fewer Gaussians or shorter GOPs, or choose `device='cpu'`"
        ) from error


def upload(gop: Gop, device: torch.device) -> dict[str, Tensor]:
    """Copy a GOP to a device, its Gaussians in the order they are rendered fastest in.

    Any order gives the same pictures, but for rounding.
    """
    with memory_checked("hold a GOP"):
        tensors = _copied(gop, device)
        cell = ((tensors["position"] + 1) * (0.5 * _TILES)).nan_to_num().long().clamp(0, _TILES - 1)
        order = torch.argsort(cell[:, 1] * _TILES + cell[:, 0], stable=True)
        return {
            name: tensor if name in _GRIDS else tensor[order] for name, tensor in tensors.items()
        }


def _copied(gop: Gop, device: torch.device) -> dict[str, Tensor]:
    return {
        name: torch.from_numpy(np.ascontiguousarray(getattr(gop, name))).to(device)
        for name in Gop.__slots__
    }


def render(
    parameters: Parameters,
    taus: Tensor,
    size: Size,
    coded_size: Size,
    *,
    blending: Blending,
    bit_depth: int,
    out: Tensor,
    backdrop: Tensor | None = None,
) -> None:
    """Render frames of a GOP that is on a device; nothing waits for it.

    Args:
        parameters: of the GOP; see `upload`.
        taus: (F,) float32 on that device, normalised times in [-1, 1].
        size: width and height to render at, pixels.
        coded_size: width and height of the coded frame, pixels.
        blending: how pictures are formed.
        bit_depth: bits of a sample, 8 to 16.
        out: (F, height, width, 3) on that device, contiguous, uint8 for 8 bits and uint16 for
            more: filled.
        backdrop: (H, W, 4) float32 on that device, added to the sums of each frame; None =
            nothing.

    Raises:
        DeviceError: the memory of the device does not suffice.
    """
    with memory_checked(f"render at {size[0]}x{size[1]}"):
        gaussians = len(parameters["position"])
        together = max(1, _PASS_BYTES // scratch_bytes(size, gaussians, blending))
        for first in range(0, len(taus), together):
            part = slice(first, first + together)
            run = Pass(parameters, taus[part], size, coded_size, blending, backdrop)
            run.codes(out[part], 2.0**bit_depth - 1)


def empty_codes(shape: tuple[int, ...], bit_depth: int, device: str) -> Tensor:
    """Room for samples: uint8 for 8 bits, uint16 for more."""
    dtype = torch.uint8 if bit_depth == 8 else torch.uint16
    with memory_checked("hold pictures"):
        return torch.empty(shape, dtype=dtype, device=device)


def squared_error(
    parameters: Parameters,
    taus: Tensor,
    targets: Tensor,
    coded_size: Size,
    blending: Blending,
    backdrop: Tensor | None = None,
) -> tuple[Tensor, dict[str, Tensor]]:
    """Mean squared error of clamped frames in [0, 1], and its gradients.

    Nothing waits for the device. The gradient passes through the clamp.

    Args:
        parameters: of the GOP.
        taus: (F,) float32 on the same device.
        targets: (F, H, W, 3) uint8 on the same device; the frames are rendered at this size.
        coded_size: width and height that scales are relative to.
        blending: how pictures are formed.
        backdrop: (H, W, 4) float32 on the same device, added to the sums of each frame; None =
            nothing.

    Returns:
        A scalar on the device, and the gradient of each parameter.

    Raises:
        DeviceError: the memory of the device does not suffice.
    """
    size = targets.shape[2], targets.shape[1]
    with memory_checked(f"fit {len(parameters['position'])} Gaussians to {size[0]}x{size[1]}"):
        run = Pass(parameters, taus, size, coded_size, blending, backdrop)
        return run.residual(targets), run.gradients()


class TritonBackend(Backend):
    """Renders on one GPU, or in Triton's interpreter."""

    def __init__(self, device: str, blending: Blending = "mean") -> None:
        """Render on "cuda:N"; on "cpu" if Triton interprets."""
        self.device, self.xp = device, torch
        self.blending = blending
        self._place = torch.device(device)
        self._recorder = Recorder(self._place)

    def prepare(self, gop: Gop) -> dict[str, Tensor]:
        """Copy a GOP to the device, in the order that is rendered fastest."""
        return upload(gop, self._place)

    def render(
        self,
        prepared: Parameters,
        taus: Float32Array,
        size: Size,
        coded_size: Size,
        *,
        bit_depth: int = 8,
        out: Any = None,
    ) -> Any:
        """Render frames of a prepared GOP.

        Returns `out`, an array or a tensor on the device; or a new array.
        """
        shape = (len(taus), size[1], size[0], 3)
        in_place = isinstance(out, Tensor)
        frames = out if in_place else empty_codes(shape, bit_depth, self.device)
        if out is not None and tuple(out.shape) != shape:
            raise ValueError(f"out must be of shape {shape}, not {tuple(out.shape)}")
        times = self._times(taus)
        render(
            prepared,
            times,
            size,
            coded_size,
            blending=self.blending,
            bit_depth=bit_depth,
            out=frames,
            backdrop=self.behind(size),
        )
        if in_place:
            return out
        if out is None:
            return frames.numpy(force=True)
        np.copyto(out, frames.numpy(force=True), casting="no")
        return out

    def picture(
        self, prepared: Parameters, tau: float, size: Size, coded_size: Size
    ) -> Float32Array:
        """Render one frame, (H, W, 3), neither clamped nor rounded."""
        with memory_checked(f"render at {size[0]}x{size[1]}"):
            floats = self._pass(prepared, tau, size, coded_size).floats()
        picture: Float32Array = floats[0].numpy(force=True)
        return picture

    def sums(self, prepared: Parameters, tau: float, size: Size, coded_size: Size) -> Float32Array:
        """Return the sums that a frame is made of, (H, W, 4)."""
        with memory_checked(f"render at {size[0]}x{size[1]}"):
            four = self._pass(prepared, tau, size, coded_size).sums()
        sums: Float32Array = four[0].numpy(force=True)
        return sums

    def _pass(
        self,
        parameters: Parameters,
        tau: float,
        size: Size,
        coded_size: Size,
        backdrop: Samples | None = None,
    ) -> Pass:
        behind = self.behind(size, backdrop)
        return Pass(parameters, self._times([tau]), size, coded_size, self.blending, behind)

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
        with memory_checked(f"differentiate {len(gop)} Gaussians at {size[0]}x{size[1]}"):
            run = self._pass(_copied(gop, self._place), tau, size, coded_size, backdrop)
            run.set_gradient(self.upload(weights[None]))
            found = run.gradients()
        return Gop(**{name: found[name].numpy(force=True) for name in Gop.__slots__})

    def squared_error(
        self,
        parameters: Parameters,
        tau: Scalar,
        target: Samples,
        coded_size: Size,
        backdrop: Samples | None = None,
        weights: Float32Array | None = None,
    ) -> tuple[Tensor, Sequence[Tensor]]:
        """Return the mean squared error of one clamped frame and its gradients."""
        assert weights is None
        times = self._number(tau)
        size = target.shape[1], target.shape[0]
        how = coded_size, self.blending, self.behind(size, backdrop)
        loss, named = squared_error(parameters, times, target[None], *how)
        return loss, [named[name] for name in parameters]

    def adam_step(
        self,
        parts: Sequence[AdamPart],
        gradients: Sequence[Tensor],
        rule: AdamRule,
        factor: Scalar,
        step: Scalar,
    ) -> None:
        """Take one step of Adam in place."""
        numbers = self._number(factor), self._number(step)
        for part, slope in zip(parts, gradients, strict=True):
            if not part.value.numel():
                continue
            value, gradient = part.value, slope
            if part.axes is not None:
                gradient = (part.axes * slope[:, :, None]).sum(1)
                value = torch.zeros_like(value)
            with on_device(self._place):
                adam_update[(triton.cdiv(value.numel(), NUMBERS.value),)](
                    value,
                    gradient.contiguous(),
                    part.mean,
                    part.square,
                    part.rates,
                    value if part.pace is None else part.pace,
                    value.numel(),
                    len(part.rates),
                    *numbers,
                    *rule.betas,
                    *rule[1:],
                    PACED=part.pace is not None,
                )
            if part.axes is not None:
                part.value.add_((part.axes * value[:, None]).sum(2))

    def sigmoid(self, values: Tensor) -> Tensor:
        """Return 1 / (1 + exp(-x)) of each number, in one launch."""
        return torch.sigmoid(values)

    def recorded(self, step: Callable[..., None]) -> Callable[..., None]:
        """Return a step that is one launch when it is repeated."""
        return Recorded(step, self._recorder)

    def upload(self, samples: NDArray[Any]) -> Tensor:
        """Copy frames or a picture to the device."""
        with memory_checked(f"hold an array of shape {samples.shape}"):
            return torch.from_numpy(np.ascontiguousarray(samples)).to(self._place)

    def hold(self, values: NDArray[Any]) -> Tensor:
        """Copy numbers to the device."""
        return self.upload(values)

    def fetch(self, values: Tensor) -> NDArray[Any]:
        """Copy numbers from the device."""
        array: NDArray[Any] = values.numpy(force=True)
        return array

    def _number(self, value: Scalar) -> Tensor:
        if isinstance(value, Tensor):
            return value
        return torch.full((1,), value, dtype=torch.float32, device=self._place)

    def _times(self, taus: Float32Array | list[float]) -> Tensor:
        return torch.from_numpy(np.ascontiguousarray(taus, np.float32)).to(self._place)
