"""The native CPU backend: C++ kernels, threads, NumPy arrays in and out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.model.gop import Float32Array, Gop
from gsvrcodec.native import _core


def render_frames(
    gop: Gop,
    taus: Float32Array,
    size: tuple[int, int],
    coded_size: tuple[int, int],
    *,
    threads: int = 0,
    out: NDArray[np.uint8] | None = None,
) -> NDArray[np.uint8]:
    """Render frames of one GOP; see `gsvrcodec.render.render_frames`."""
    width, height = size
    shape = (len(taus), height, width, 3)
    if out is None:
        out = np.empty(shape, np.uint8)
    elif out.shape != shape or out.dtype != np.uint8 or not out.flags.c_contiguous:
        raise ValueError(f"out must be a C-contiguous uint8 array of shape {shape}")
    _core.render_rgb8(parameters(gop), taus, out, *coded_size, threads)
    return out


def parameters(gop: Gop) -> _core.Parameters:
    """The core's view of a GOP: no copy, shapes checked."""
    return _core.Parameters(*(getattr(gop, name) for name in Gop.__slots__))


def render_weights(gop: Gop, tau: float, size: tuple[int, int]) -> Float32Array:
    """Sum of red weights at each pixel, (H, W): neither clamped nor rounded."""
    width, height = size
    out = np.empty((1, height, width, 3), np.float32)
    _core.render_float(parameters(gop), np.array([tau], np.float32), out, width, height, 0)
    return np.ascontiguousarray(out[0, ..., 0])
