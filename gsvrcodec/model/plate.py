"""Plate: a still picture behind the Gaussians of a chain (spec sections "Plate", "Rendering")."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.model.gop import Float32Array
from gsvrcodec.model.reconstruction import PLATE_WEIGHT


@dataclass(frozen=True, slots=True, eq=False)
class Plate:
    """A still picture; lies behind all Gaussians."""

    ycc: NDArray[np.uint8]  #: (3, H, W) Y, Cb, Cr of full range, at the coded size
    _held: dict[Hashable, dict[tuple[int, int], Any]] = field(default_factory=dict, repr=False)

    @property
    def colours(self) -> Float32Array:
        """Red, green and blue, (H, W, 3); 1 is white."""
        middle = np.array([0, 128, 128], np.float32)[:, None, None]
        y, cb, cr = self.ycc.astype(np.float32) - middle
        red, blue = y + np.float32(1.402) * cr, y + np.float32(1.772) * cb
        green = y - np.float32(0.344136) * cb - np.float32(0.714136) * cr
        colours: Float32Array = np.stack([red, green, blue], axis=-1) * np.float32(1 / 255)
        return colours

    def __reduce__(self) -> tuple[type[Plate], tuple[NDArray[np.uint8]]]:
        """Pickle the picture alone."""
        return Plate, (self.ycc,)

    def shown(self) -> NDArray[np.uint8]:
        """Return the plate alone, at the coded size, (H, W, 3) RGB; the array is read-only."""

        def codes() -> NDArray[np.uint8]:
            codes = np.rint(np.clip(self.colours, 0, 1) * 255).astype(np.uint8)
            codes.setflags(write=False)
            return codes

        shown: NDArray[np.uint8] = self.held(self.size, "shown", codes)
        return shown

    def sums(self, size: tuple[int, int]) -> Float32Array:
        """Return what the plate adds to the sums of a frame: (H, W, 4), weighted colours, weights.

        Args:
            size: Width and height of the frame, pixels.
        """
        width, height = size
        rows = _resampled(self.colours, height)
        out = np.full((height, width, 4), PLATE_WEIGHT, np.float32)
        out[..., :3] *= _resampled(rows.swapaxes(0, 1), width).swapaxes(0, 1)
        return out

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the coded frame, pixels."""
        return self.ycc.shape[2], self.ycc.shape[1]

    def held(self, size: tuple[int, int], place: Hashable, hold: Callable[[], Any]) -> Any:
        """Return the plate as a backend holds it behind a frame; those of two sizes are kept.

        Args:
            size: Width and height of the frame, pixels.
            place: Where the backend has it.
            hold: Brings it there.
        """
        kept = self._held.get(place, {})
        if size not in kept:
            last = dict(list(kept.items())[-1:])
            kept = self._held[place] = last | {size: hold()}
        return kept[size]


def _resampled(samples: Float32Array, count: int) -> Float32Array:
    """Resample the first axis of (N, ...) to `count`, by a triangle as wide as 1 or N / count."""
    coded = len(samples)
    if count == coded:
        return samples
    reach = max(1.0, coded / count)
    at = (np.arange(count) + 0.5) * coded / count - 0.5
    first = np.floor(at - reach).astype(np.intp) + 1
    out = np.zeros((count, *samples.shape[1:]), np.float32)
    numbers = first[:, None] + np.arange(int(np.ceil(2 * reach)))
    weights = np.maximum(1 - np.abs(numbers - at[:, None]) / reach, 0)
    weights[(numbers < 0) | (numbers >= coded)] = 0
    weights /= weights.sum(axis=1, keepdims=True)
    for number, weight in zip(numbers.T, weights.T.astype(np.float32), strict=True):
        out += weight[:, None, None] * samples[np.clip(number, 0, coded - 1)]
    return out
