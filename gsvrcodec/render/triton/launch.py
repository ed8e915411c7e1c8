"""One pass of the kernels over frames of a GOP: arguments, scratch memory, order of launches."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import numpy as np
import torch
import triton
from torch import Tensor

from gsvrcodec.model.gop import TRIPLANE_CHANNELS, Gop
from gsvrcodec.model.pyramid import level_size, zoom
from gsvrcodec.model.reconstruction import ANTIALIAS, DILATION, LEVEL_SCALE, LEVELS, Blending
from gsvrcodec.render.backend import Size
from gsvrcodec.render.triton.deform import project
from gsvrcodec.render.triton.deform_backward import deform_backward
from gsvrcodec.render.triton.geometry import BLOCK, ELLIPSE, END
from gsvrcodec.render.triton.planes import sum_cells
from gsvrcodec.render.triton.pyramid import (
    PIXELS,
    SAMPLES,
    fold,
    residual,
    spread,
    to_codes,
    to_floats,
    to_sums,
    weigh,
)
from gsvrcodec.render.triton.raster import gather, rasterise, tiles_of

Parameters = Mapping[str, Tensor]  #: the fields of `Gop`, float32 and contiguous, on one device

#: Blocks or Gaussians that a program looks at together.
CHUNK = 256

_NAMES = Gop.__slots__


class Pass:
    """Deforms and rasterises on construction; then gives samples, or a residual and gradients."""

    def __init__(
        self,
        parameters: Parameters,
        taus: Tensor,
        size: Size,
        coded_size: Size,
        blending: Blending,
        backdrop: Tensor | None = None,
    ) -> None:
        """Launch the forward kernels.

        Args:
            parameters: of the GOP.
            taus: (F,) float32 on the same device.
            size: width and height to render at.
            coded_size: width and height that scales are relative to.
            blending: how pictures are formed.
            backdrop: (H, W, 4) float32, added to the sums of each frame; None = nothing.
        """
        self._sums = sums_of(blending)
        self._arrays = [parameters[name] for name in _NAMES]
        self._taus, self._size, self._coded_size = taus, size, coded_size
        self._device, self._backdrop = taus.device, backdrop
        self._n = len(parameters["position"])
        self._blocks = triton.cdiv(self._n, BLOCK.value)
        gy, gx, _ = parameters["xy"].shape
        self._grid = gx, gy, len(parameters["xt"])
        self._planes = bool(gx and gy)
        self._levels = [level_size(size, level) for level in range(LEVELS)]
        self._floats = self._sums * sum(width * height for width, height in self._levels)
        self.frames = len(taus)
        self._picture = self._empty(self.frames, self._floats)
        self._projection = projection(size, coded_size)
        with on_device(self._device):
            self._forward()

    def _empty(self, *shape: int, dtype: torch.dtype = torch.float32) -> Tensor:
        return torch.empty(shape, dtype=dtype, device=self._device)

    def _forward(self) -> None:
        frames, n, blocks = self.frames, self._n, self._blocks
        self._splats = self._empty(frames, n, ELLIPSE.value + self._sums)
        self._level = self._empty(frames, n, dtype=torch.int32)
        self._places = self._empty(4, blocks)
        bounds = self._empty(frames, LEVELS, 4, blocks)
        if blocks:
            project[(blocks, frames)](
                *self._arrays,
                self._taus,
                self._splats,
                self._level,
                bounds,
                self._places,
                n,
                *self._grid,
                *self._size,
                *self._projection,
                PLANES=self._planes,
                SUMS=self._sums,
                num_warps=2,
            )
        tiles = sum(tiles_of(*size) for size in self._levels)
        rasterise[(tiles, frames)](
            self._splats,
            self._level,
            bounds,
            self._picture,
            self._empty(frames, tiles, 2, CHUNK, dtype=torch.int32),
            n,
            blocks,
            self._floats,
            *self._size,
            CHUNK=CHUNK,
            SUMS=self._sums,
            num_warps=4,
        )
        for level in range(LEVELS - 2, 0, -1):
            self._launch_level(fold, level)

    def _launch_level(self, kernel: Any, level: int) -> None:
        width, height = self._levels[level]
        grid = triton.cdiv(self._sums * width * height, SAMPLES.value), self.frames
        kernel[grid](self._picture, self._floats, level, *self._size, SUMS=self._sums)

    @property
    def _behind(self) -> Tensor:
        """What kernels take for a backdrop, which they do not read if there is none."""
        return self._picture if self._backdrop is None else self._backdrop

    def _pixel_grid(self) -> tuple[int, int]:
        width, height = self._size
        return triton.cdiv(width * height, PIXELS.value), self.frames

    def codes(self, out: Tensor, white: float) -> None:
        """Fill `out` (F, H, W, 3), uint8 or uint16, with samples that are `white` where 1."""
        with on_device(self._device):
            to_codes[self._pixel_grid()](
                self._picture,
                out,
                self._behind,
                self._floats,
                *self._size,
                white,
                SUMS=self._sums,
                BACKDROP=self._backdrop is not None,
            )

    def floats(self) -> Tensor:
        """Samples (F, H, W, 3), neither clamped nor rounded."""
        return self._pixels(to_floats, 3)

    def sums(self) -> Tensor:
        """Sums of weighted colours, and of weights, (F, H, W, 4); the last is 0 of a sum."""
        return self._pixels(to_sums, 4)

    def _pixels(self, kernel: Any, channels: int) -> Tensor:
        width, height = self._size
        shape = self.frames, height, width, channels
        out = torch.zeros(shape, dtype=torch.float32, device=self._device)
        with on_device(self._device):
            kernel[self._pixel_grid()](
                self._picture,
                out,
                self._behind,
                self._floats,
                *self._size,
                SUMS=self._sums,
                BACKDROP=self._backdrop is not None,
            )
        return out

    def pixels_drawn(self) -> float:
        """Pixels in all ellipses of all frames, on their levels: what there is to evaluate."""
        across, down = self._splats[..., 3], self._splats[..., 4]
        area = math.pi * END.value / (across * down).sqrt()
        return float(area[self._level >= 0].sum())

    def residual(self, target: Tensor) -> Tensor:
        """Turn the picture into the gradient of the error that is returned.

        Args:
            target: (F, H, W, 3) uint8.

        Returns:
            Mean squared error of the clamped frames in [0, 1], a scalar on the device. The
            gradient passes through the clamp.
        """
        count = target.numel()
        programs, frames = self._pixel_grid()
        parts = self._empty(frames, programs)
        with on_device(self._device):
            residual[(programs, frames)](
                self._picture,
                target,
                self._behind,
                parts,
                self._floats,
                *self._size,
                2.0 / count,
                255.0,
                SUMS=self._sums,
                BACKDROP=self._backdrop is not None,
            )
        return parts.sum() / count

    def set_gradient(self, gradient: Tensor) -> None:
        """Turn the picture into `gradient` (F, H, W, 3), that of the frames, for `gradients`."""
        with on_device(self._device):
            weigh[self._pixel_grid()](
                self._picture,
                gradient,
                self._behind,
                self._floats,
                *self._size,
                SUMS=self._sums,
                BACKDROP=self._backdrop is not None,
            )

    def gradients(self) -> dict[str, Tensor]:
        """Gradients of all parameters; after `residual` or `set_gradient`, once."""
        frames, n, blocks = self.frames, self._n, self._blocks
        out = self._zeros()
        if not blocks:
            return out
        moments = self._empty(frames, n, self._sums + 5)
        factors = self._empty(frames if self._planes else 0, 3, n, TRIPLANE_CHANNELS)
        named = dict(zip(_NAMES, self._arrays, strict=True))
        with on_device(self._device):
            for level in range(1, LEVELS):
                self._launch_level(spread, level)
            gather[(n, frames)](
                self._splats,
                self._level,
                self._picture,
                moments,
                n,
                self._floats,
                *self._size,
                SUMS=self._sums,
                num_warps=1,
            )
            deform_backward[(blocks,)](
                *(named[k] for k in ("position", "log_scale", "rotation", "log_opacity")),
                *(named[k] for k in ("indicator", "xy", "xt", "yt")),
                self._taus,
                self._splats,
                self._level,
                moments,
                *(out[k] for k in ("position", "log_scale", "rotation", "colour")),
                *(out[k] for k in ("log_opacity", "indicator", "linear", "quadratic")),
                factors,
                frames,
                n,
                *self._grid,
                *self._coded_size,
                *self._projection,
                PLANES=self._planes,
                SUMS=self._sums,
                num_warps=2,
            )
            if self._planes:
                self._plane_gradients(factors, out)
        return out

    def _zeros(self) -> dict[str, Tensor]:
        """Room for gradients: parts of one tensor, since a launch takes longer than to fill it."""
        # Kernels are compiled once for pointers that are multiples of 16 bytes.
        rooms = [triton.cdiv(array.numel(), 4) * 4 for array in self._arrays]
        parts = torch.zeros(sum(rooms), device=self._device).split(rooms)
        return {
            name: part[: array.numel()].view(array.shape)
            for name, part, array in zip(_NAMES, parts, self._arrays, strict=True)
        }

    def _plane_gradients(self, factors: Tensor, out: dict[str, Tensor]) -> None:
        gx, gy, gt = self._grid
        cells = self._empty(self.frames, gy, gx, 3, TRIPLANE_CHANNELS)
        sum_cells[(gx * gy, self.frames)](
            self._arrays[_NAMES.index("position")],
            self._places,
            factors,
            cells,
            self._empty(self.frames, gx * gy, CHUNK, dtype=torch.int32),
            self._n,
            self._blocks,
            gx,
            gy,
            CHUNK=CHUNK,
            num_warps=2,
        )
        out["xy"] = cells[:, :, :, 0].sum(0)
        # Each frame's line lies between two of the grid's slices of time.
        at = ((self._taus + 1) * (0.5 * (gt - 1))).clamp(0, gt - 1)
        slices = torch.arange(gt, device=self._device)
        weights = (1 - (at - slices[:, None]).abs()).clamp(min=0)  # (Gt, F)
        out["xt"] = (weights @ cells[:, :, :, 1].sum(1).flatten(1)).view(gt, gx, -1)
        out["yt"] = (weights @ cells[:, :, :, 2].sum(2).flatten(1)).view(gt, gy, -1)


def on_device(device: torch.device) -> AbstractContextManager[object]:
    """Where kernels are launched."""
    return torch.cuda.device(device) if device.type == "cuda" else nullcontext()


def sums_of(blending: Blending) -> int:
    """Sums that are formed of each pixel."""
    return 4 if blending == "mean" else 3


def scratch_bytes(size: Size, gaussians: int, blending: Blending) -> int:
    """Memory that the forward kernels take for each frame, outputs left out."""
    sums = sums_of(blending)
    levels = [level_size(size, level) for level in range(LEVELS)]
    samples = sums * sum(width * height for width, height in levels)
    lists = 2 * CHUNK * sum(tiles_of(*level) for level in levels)
    floats: int = samples + lists + (ELLIPSE.value + sums + 1) * gaussians
    return 4 * floats


def projection(size: Size, coded_size: Size) -> Sequence[float]:
    """What projection needs: zooms, smallest log-scales of levels 1 to 4, and how level 0 blurs."""
    least = zoom(size, coded_size)
    smallest = [float(np.float32(math.log(LEVEL_SCALE * 2**n / least))) for n in range(1, LEVELS)]
    blur = DILATION + ANTIALIAS * max(least**-2 - 1, 0.0)
    return size[0] / coded_size[0], size[1] / coded_size[1], *smallest, least**2, blur
