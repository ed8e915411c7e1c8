"""Which tiles of a frame the steps of a fit look at: those where much changes more often."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.fit.tuned import TILES
from gsvrcodec.model.gop import Float32Array
from gsvrcodec.render.backend import TILE, Size


class Tiles:
    """Tiles that each step looks at, so that the mean of its gradients is that of whole frames.

    A tile counts for the steps that leave it out: its weight is 1 / its share of the steps. The
    shares follow what may be won in the tiles, by the square root.

    Args:
        size: width and height of the frames, pixels.
        position: (N, 2) where Gaussians are; the frame spans [-1, 1].
        worth: (N,) what their changes may be worth, in any unit.
    """

    def __init__(self, size: Size, position: Float32Array, worth: NDArray[np.float64]) -> None:
        (width, height), (across, down) = size, TILE
        self._shape = -(-height // down), -(-width // across)
        pixel = np.clip((position + 1) / 2, 0, 1 - 1e-6) * size
        column, row = (pixel // TILE).astype(np.intp).T
        count = self._shape[0] * self._shape[1]
        won = np.bincount(row * self._shape[1] + column, worth, count)
        self.shares = _with_mean(np.sqrt(won))  #: of the steps, (tiles,), row by row
        # Golden section: neighbours are not left out in the same steps.
        self._phase = np.arange(count) * 0.6180339887498949 % 1

    def at(self, step: int) -> Float32Array:
        """Return the weights of the tiles in a step, from 1; 0 = it leaves the tile out."""
        before, after = (np.floor(n * self.shares + self._phase) for n in (step - 1, step))
        weights: Float32Array = np.where(after > before, 1 / self.shares, 0).astype(np.float32)
        return weights.reshape(self._shape)


def _with_mean(wanted: NDArray[np.float64]) -> NDArray[np.float64]:
    """Shares in proportion to `wanted`, within the bounds, whose mean is that of `TILES`."""
    wanted = wanted / max(wanted.max(), 1e-30) + 1e-9
    low, high = 1.0, 1e9
    for _ in range(60):
        middle = np.sqrt(low * high)
        if np.clip(middle * wanted, TILES.least, 1).mean() < TILES.mean:
            low = middle
        else:
            high = middle
    return np.clip(high * wanted, TILES.least, 1)
