"""The native CPU backend: C++ kernels, threads, NumPy arrays in and out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.model.gop import Float32Array, Gop, parameters_of
from gsvrcodec.model.plate import Plate
from gsvrcodec.model.reconstruction import Blending
from gsvrcodec.native import _core
from gsvrcodec.render.backend import (
    AdamPart,
    AdamRule,
    Backend,
    Codes,
    Prices,
    Samples,
    Scalar,
    Size,
    Tensor,
)


class NativeBackend(Backend):
    """Renders on the CPU; the result does not depend on the number of threads."""

    device, xp = "cpu", np
    skips_tiles = True

    def __init__(self, threads: int = 0, blending: Blending = "mean") -> None:
        """Use so many native threads; 0 = GSVR_THREADS or all cores."""
        self.blending, self.threads = blending, threads
        self._how = blending == "mean", threads

    def prepare(self, gop: Gop) -> _core.Parameters:
        """Return the core's view of a GOP: no copy, shapes checked."""
        return parameters_of(gop)

    def render(
        self,
        prepared: _core.Parameters,
        taus: Float32Array,
        size: Size,
        coded_size: Size,
        *,
        bit_depth: int = 8,
        out: Codes | None = None,
    ) -> Codes:
        """Render frames of a prepared GOP."""
        width, height = size
        shape, dtype = (len(taus), height, width, 3), np.dtype("u1" if bit_depth == 8 else "u2")
        if out is None:
            out = np.empty(shape, np.uint8) if bit_depth == 8 else np.empty(shape, np.uint16)
        elif out.shape != shape or out.dtype != dtype:
            raise ValueError(f"out must be a {dtype} array of shape {shape}")
        planes, behind = out.transpose(0, 3, 1, 2), self.behind(size)
        if bit_depth == 8 and planes.flags.c_contiguous:
            _core.render_planes8(prepared, taus, planes, *coded_size, *self._how, behind)
            return out
        if not out.flags.c_contiguous:
            raise ValueError("out must be C-contiguous, or its channels planes of one array")
        if bit_depth == 8:
            _core.render_rgb8(prepared, taus, out, *coded_size, *self._how, behind)
            return out
        values = np.empty((1, *shape[1:]), np.float32)
        for frame, tau in zip(out, taus[:, None], strict=True):
            _core.render_float(prepared, tau, values, *coded_size, *self._how, behind)
            frame[:] = np.clip(values[0], 0, 1) * (2**bit_depth - 1) + 0.5
        return out

    def picture(
        self, prepared: _core.Parameters, tau: float, size: Size, coded_size: Size
    ) -> Float32Array:
        """Render one frame, (H, W, 3), neither clamped nor rounded."""
        width, height = size
        out = np.empty((1, height, width, 3), np.float32)
        taus = np.array([tau], np.float32)
        _core.render_float(prepared, taus, out, *coded_size, *self._how, self.behind(size))
        picture: Float32Array = out[0]
        return picture

    def sums(
        self, prepared: _core.Parameters, tau: float, size: Size, coded_size: Size
    ) -> Float32Array:
        """Return the sums that a frame is made of, (H, W, 4)."""
        width, height = size
        out = np.empty((1, height, width, 4), np.float32)
        taus = np.array([tau], np.float32)
        _core.render_sums(prepared, taus, out, *coded_size, *self._how, self.behind(size))
        sums: Float32Array = out[0]
        return sums

    def gradient(
        self,
        gop: Gop,
        tau: float,
        weights: Float32Array,
        coded_size: Size,
        backdrop: Samples | None = None,
    ) -> Gop:
        """Return the gradient of sum(weights * picture) in place of each parameter."""
        gradient = Gop(**{name: np.empty_like(getattr(gop, name)) for name in Gop.__slots__})
        mean, threads = self._how
        core = parameters_of(gop), tau, weights, *coded_size, mean, parameters_of(gradient), threads
        _core.backward_float(*core, self.behind(weights.shape[1::-1], backdrop))
        return gradient

    def squared_error(
        self,
        parameters: Mapping[str, Tensor],
        tau: Scalar,
        target: Samples,
        coded_size: Size,
        backdrop: Samples | None = None,
        weights: Float32Array | None = None,
    ) -> tuple[float, Sequence[Tensor]]:
        """Render, compare and differentiate in one call of the core."""
        gradients = [np.empty(value.shape, np.float32) for value in parameters.values()]
        mean, threads = self._how
        error = _core.squared_error(
            _core.Parameters(*parameters.values()),
            tau,
            target,
            *coded_size,
            mean,
            _core.Parameters(*gradients),
            threads,
            self.behind(target.shape[1::-1], backdrop),
            weights,
        )
        return error, gradients

    def upload(self, samples: NDArray[Any]) -> Samples:
        """Return what the core takes: sums, (H, W, 4), as a backdrop."""
        return _core.Backdrop(samples) if samples.shape[-1] == 4 else samples

    def upload_plate(self, plate: Plate, size: Size) -> Samples:
        """Return what the core takes: at the coded size its codes."""
        coded = plate.size == size
        return _core.Backdrop(ycc=plate.ycc) if coded else super().upload_plate(plate, size)

    def hold(self, values: NDArray[Any]) -> Tensor:
        """Return the numbers."""
        return values

    def fetch(self, values: Tensor) -> NDArray[Any]:
        """Return the numbers."""
        array: NDArray[Any] = values
        return array

    def adam_step(
        self,
        parts: Sequence[AdamPart],
        gradients: Sequence[Tensor],
        rule: AdamRule,
        factor: Scalar,
        step: Scalar,
    ) -> None:
        """Take one step of Adam in place, in one call of the core."""
        for part in parts:
            if part.held is None:
                arrays = part.value, part.mean, part.square, part.rates, part.pace, part.axes
                part.held = _core.AdamPart(*arrays)
        held = [part.held for part in parts]
        _core.adam_step(held, list(gradients), factor, *rule.betas, *rule[1:], step, self._how[1])

    def price_slopes(
        self, value: Tensor, step: Tensor, carried: Tensor | None, prices: Prices
    ) -> Tensor:
        """Compute the slopes of prices of bits in one call of the core."""
        slopes = np.empty(value.shape, np.float32)
        change, fresh, near = prices
        _core.price_slopes(value, step, carried, near, change, fresh, slopes, self._how[1])
        return slopes


def resolve_threads(wanted: int) -> int:
    """Return how many native threads `wanted` stands for; 0 = GSVR_THREADS or all cores."""
    return _core.resolve_threads(wanted)
