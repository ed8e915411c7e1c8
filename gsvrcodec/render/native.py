"""The native CPU backend: C++ kernels, threads, NumPy arrays in and out."""

from __future__ import annotations

import numpy as np

from gsvrcodec.model.gop import Float32Array, Gop
from gsvrcodec.native import _core
from gsvrcodec.render import Codes


def render_frames(
    gop: Gop,
    taus: Float32Array,
    size: tuple[int, int],
    coded_size: tuple[int, int],
    *,
    bit_depth: int = 8,
    threads: int = 0,
    out: Codes | None = None,
) -> Codes:
    """Render frames of one GOP; see `gsvrcodec.render.render_frames`."""
    width, height = size
    shape, dtype = (len(taus), height, width, 3), np.dtype("u1" if bit_depth == 8 else "u2")
    if out is None:
        out = np.empty(shape, np.uint8) if bit_depth == 8 else np.empty(shape, np.uint16)
    elif out.shape != shape or out.dtype != dtype or not out.flags.c_contiguous:
        raise ValueError(f"out must be a C-contiguous {dtype} array of shape {shape}")
    if bit_depth == 8:
        _core.render_rgb8(parameters(gop), taus, out, *coded_size, threads)
        return out
    values = np.empty((1, *shape[1:]), np.float32)
    for frame, tau in zip(out, taus[:, None], strict=True):
        _core.render_float(parameters(gop), tau, values, *coded_size, threads)
        frame[:] = np.clip(values[0], 0, 1) * (2**bit_depth - 1) + 0.5
    return out


def parameters(gop: Gop) -> _core.Parameters:
    """The core's view of a GOP: no copy, shapes checked."""
    return _core.Parameters(*(getattr(gop, name) for name in Gop.__slots__))


def render_linear(
    gop: Gop, tau: float, size: tuple[int, int], coded_size: tuple[int, int], threads: int = 0
) -> Float32Array:
    """Render one frame, (H, W, 3), neither clamped nor rounded."""
    width, height = size
    out = np.empty((1, height, width, 3), np.float32)
    taus = np.array([tau], np.float32)
    _core.render_float(parameters(gop), taus, out, *coded_size, threads)
    picture: Float32Array = out[0]
    return picture


def render_weights(gop: Gop, tau: float, size: tuple[int, int]) -> Float32Array:
    """Sum of red weights at each pixel, (H, W): neither clamped nor rounded."""
    return np.ascontiguousarray(render_linear(gop, tau, size, size)[..., 0])
