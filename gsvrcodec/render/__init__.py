"""From a GOP's parameters to frames: one interface, several backends that agree.

Backends: `native` (C++ on the CPU), `triton` (GPUs) and `reference` (torch float64, slow: the
specification in code, which the others are tested against).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np

from gsvrcodec.errors import UsageError
from gsvrcodec.model.gop import Float32Array, Gop
from gsvrcodec.model.reconstruction import Blending
from gsvrcodec.render.backend import Backend, Codes, Prepared, Size

if TYPE_CHECKING:
    from torch import Tensor

__all__ = [
    "Backend",
    "Codes",
    "Prepared",
    "Size",
    "as_tensor",
    "backend_on",
    "empty_frames",
    "render_frames",
]


def backend_on(device: str, threads: int = 0, blending: Blending = "mean") -> Backend:
    """Return the backend of a device.

    Args:
        device: "cpu" or "cuda:N"; see `gsvrcodec.render.device.choose_device`.
        threads: native threads; 0 = GSVR_THREADS or all cores. Does not change a result.
        blending: how pictures are formed.
    """
    if device != "cpu":
        from gsvrcodec.render.triton import TritonBackend

        return TritonBackend(device, blending)
    from gsvrcodec.render.native import NativeBackend

    return NativeBackend(threads, blending)


def render_frames(
    gop: Gop,
    taus: Float32Array,
    size: Size,
    coded_size: Size,
    *,
    backend: Literal["native", "reference"] = "native",
    device: str = "cpu",
    bit_depth: int = 8,
    threads: int = 0,
    out: Codes | None = None,
    blending: Blending = "mean",
) -> Codes:
    """Render frames of one GOP (spec section "Reconstruction").

    Args:
        gop: parameters of the GOP.
        taus: (F,) float32, normalised times in [-1, 1].
        size: width and height to render at, pixels.
        coded_size: width and height of the coded frame, which scales are relative to, pixels.
        backend: "native" or "reference", on the CPU.
        device: "cpu"; or "cuda:N" to render on a GPU.
        bit_depth: bits of a sample, 8 to 16; white is the code 2^bit_depth - 1.
        threads: native threads; 0 = GSVR_THREADS or all cores. Does not change the result.
        out: (F, height, width, 3), C-contiguous, uint8 for 8 bits and uint16 for more, to be
            filled; None = a new array. With a GPU it may be a tensor there; see `empty_frames`.
            For 8 bits on the CPU it may also be so as (F, 3, height, width).
        blending: how pictures are formed.

    Returns:
        (F, height, width, 3) RGB: `out`, or the new array. A frame is the same whatever others
        are rendered with it.

    Raises:
        DeviceError: the memory of the GPU does not suffice.
        ValueError: a shape is wrong, or the backend or the bit depth unknown.
    """
    if not 8 <= bit_depth <= 16:
        raise ValueError(f"bit_depth must be 8 to 16, not {bit_depth}")
    if backend == "native":
        chosen = backend_on(device, threads, blending)
    elif backend == "reference":
        from gsvrcodec.render.reference import ReferenceBackend

        chosen = ReferenceBackend(blending)
    else:
        raise ValueError(f"backend must be 'native' or 'reference', not {backend!r}")
    prepared = chosen.prepare(gop)
    return chosen.render(prepared, taus, size, coded_size, bit_depth=bit_depth, out=out)


def empty_frames(count: int, size: Size, *, bit_depth: int = 8, device: str = "cpu") -> Codes:
    """Return room for `count` frames of `size` (width, height): (count, height, width, 3).

    An array; or a torch tensor on a GPU if `device` is one, although its type does not say so.

    Raises:
        DeviceError: the memory of the GPU does not suffice.
    """
    shape = (count, size[1], size[0], 3)
    if device != "cpu":
        from gsvrcodec.render import triton

        frames: Any = triton.empty_codes(shape, bit_depth, device)
        return cast(Codes, frames)
    if bit_depth == 8:
        return np.empty(shape, np.uint8)
    return np.empty(shape, np.uint16)


def as_tensor(frames: Codes) -> Tensor:
    """Return frames as a torch tensor that shares their memory; a tensor is returned as it is.

    Raises:
        UsageError: PyTorch is not installed.
    """
    if not isinstance(frames, np.ndarray):
        return frames
    try:
        import torch
    except ModuleNotFoundError as error:
        raise UsageError("tensors need PyTorch: pip install torch") from error

    return torch.from_numpy(frames)
