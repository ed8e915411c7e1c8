"""One pass of the kernels over frames of a GOP: arguments, scratch memory, order of launches."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext

import numpy as np
import torch
import triton
from torch import Tensor

from gsvrcodec.model.gop import TRIPLANE_CHANNELS, Gop
from gsvrcodec.model.pyramid import level_size, zoom
from gsvrcodec.model.reconstruction import ANTIALIAS, DILATION, LEVEL_SCALE, LEVELS
from gsvrcodec.render.backend import Size
from gsvrcodec.render.triton.deform import project
from gsvrcodec.render.triton.deform_backward import deform_backward
from gsvrcodec.render.triton.geometry import BLOCK, END, SPLAT
from gsvrcodec.render.triton.planes import sum_cells
from gsvrcodec.render.triton.pyramid import SAMPLES, fold, residual, spread, to_codes, to_floats
from gsvrcodec.render.triton.raster import gather, rasterise, tiles_of

Parameters = Mapping[str, Tensor]  #: the fields of `Gop`, float32 and contiguous, on one device

#: Blocks or Gaussians that a program looks at together.
CHUNK = 256

_NAMES = Gop.__slots__


class Pass:
    """Deforms and rasterises on construction; then gives samples, or a residual and gradients."""

    def __init__(self, parameters: Parameters, taus: Tensor, size: Size, coded_size: Size) -> None:
        """Launch the forward kernels.

        Args:
            parameters: of the GOP.
            taus: (F,) float32 on the same device.
            size: width and height to render at.
            coded_size: width and height that scales are relative to.
        """
        self._arrays = [parameters[name] for name in _NAMES]
        self._taus, self._size, self._coded_size = taus, size, coded_size
        self._device = taus.device
        self._n = len(parameters["position"])
        self._blocks = triton.cdiv(self._n, BLOCK.value)
        gy, gx, _ = parameters["xy"].shape
        self._grid = gx, gy, len(parameters["xt"])
        self._planes = bool(gx and gy)
        self._levels = [level_size(size, level) for level in range(LEVELS)]
        self._floats = 3 * sum(width * height for width, height in self._levels)
        self.frames = len(taus)
        self._picture = self._empty(self.frames, self._floats)
        self._projection = projection(size, coded_size)
        with on_device(self._device):
            self._forward()

    def _empty(self, *shape: int, dtype: torch.dtype = torch.float32) -> Tensor:
        return torch.empty(shape, dtype=dtype, device=self._device)

    def _forward(self) -> None:
        frames, n, blocks = self.frames, self._n, self._blocks
        self._splats = self._empty(frames, n, SPLAT.value)
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
            num_warps=4,
        )
        for level in range(LEVELS - 2, 0, -1):
            fold[self._sample_grid(level)](self._picture, self._floats, level, *self._size)

    def _sample_grid(self, level: int) -> tuple[int, int]:
        width, height = self._levels[level]
        return triton.cdiv(3 * width * height, SAMPLES.value), self.frames

    def codes(self, out: Tensor, white: float) -> None:
        """Fill `out` (F, H, W, 3), uint8 or uint16, with samples that are `white` where 1."""
        with on_device(self._device):
            to_codes[self._sample_grid(0)](self._picture, out, self._floats, *self._size, white)

    def floats(self) -> Tensor:
        """Samples (F, H, W, 3), neither clamped nor rounded."""
        width, height = self._size
        out = self._empty(self.frames, height, width, 3)
        with on_device(self._device):
            to_floats[self._sample_grid(0)](self._picture, out, self._floats, *self._size)
        return out

    def pixels_drawn(self) -> float:
        """Pixels in all ellipses of all frames, on their levels: what there is to evaluate."""
        across, down = self._splats[..., 3], self._splats[..., 4]
        area = math.pi * END.value / (across * down).sqrt()
        return float(area[self._level >= 0].sum())

    def residual(self, target: Tensor, backdrop: Tensor | None = None) -> Tensor:
        """Turn the picture into the gradient of the error that is returned.

        Args:
            target: (F, H, W, 3) uint8.
            backdrop: (H, W, 3) float32, added to each frame; None = black.

        Returns:
            Mean squared error of the clamped frames in [0, 1], a scalar on the device. The
            gradient passes through the clamp.
        """
        count = target.numel()
        programs, frames = self._sample_grid(0)
        sums = self._empty(frames, programs)
        with on_device(self._device):
            residual[(programs, frames)](
                self._picture,
                target,
                sums if backdrop is None else backdrop,
                sums,
                self._floats,
                *self._size,
                2.0 / count,
                255.0,
                BACKDROP=backdrop is not None,
            )
        return sums.sum() / count

    def set_gradient(self, gradient: Tensor) -> None:
        """Make `gradient` (F, H, W, 3) that of the frames, for `gradients`."""
        width, height = self._size
        self._picture[:, : 3 * width * height] = gradient.permute(0, 3, 1, 2).flatten(1)

    def gradients(self) -> dict[str, Tensor]:
        """Gradients of all parameters; after `residual` or `set_gradient`, once."""
        frames, n, blocks = self.frames, self._n, self._blocks
        out = {name: torch.zeros_like(a) for name, a in zip(_NAMES, self._arrays, strict=True)}
        if not blocks:
            return out
        moments = self._empty(frames, n, SPLAT.value)
        factors = self._empty(frames if self._planes else 0, 3, n, TRIPLANE_CHANNELS)
        named = dict(zip(_NAMES, self._arrays, strict=True))
        with on_device(self._device):
            for level in range(1, LEVELS):
                spread[self._sample_grid(level)](self._picture, self._floats, level, *self._size)
            gather[(n, frames)](
                self._splats,
                self._level,
                self._picture,
                moments,
                n,
                self._floats,
                *self._size,
                num_warps=1,
            )
            deform_backward[(blocks,)](
                *(named[k] for k in ("position", "log_scale", "rotation", "indicator")),
                *(named[k] for k in ("xy", "xt", "yt")),
                self._taus,
                self._splats,
                self._level,
                moments,
                *(out[k] for k in ("position", "log_scale", "rotation", "colour", "indicator")),
                *(out[k] for k in ("linear", "quadratic")),
                factors,
                frames,
                n,
                *self._grid,
                *self._coded_size,
                *self._projection,
                PLANES=self._planes,
                num_warps=2,
            )
            if self._planes:
                self._plane_gradients(factors, out)
        return out

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


def scratch_bytes(size: Size, gaussians: int) -> int:
    """Memory that the forward kernels take for each frame, outputs left out."""
    levels = [level_size(size, level) for level in range(LEVELS)]
    samples = 3 * sum(width * height for width, height in levels)
    lists = 2 * CHUNK * sum(tiles_of(*level) for level in levels)
    floats: int = samples + lists + (SPLAT.value + 1) * gaussians
    return 4 * floats


def projection(size: Size, coded_size: Size) -> Sequence[float]:
    """What projection needs: zooms, smallest log-scales of levels 1 to 4, and how level 0 blurs."""
    least = zoom(size, coded_size)
    smallest = [float(np.float32(math.log(LEVEL_SCALE * 2**n / least))) for n in range(1, LEVELS)]
    blur = DILATION + ANTIALIAS * max(least**-2 - 1, 0.0)
    return size[0] / coded_size[0], size[1] / coded_size[1], *smallest, least**2, blur
