"""The frames that a fit has to show."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from gsvrcodec.model.gop import Float32Array, Gop
from gsvrcodec.render.backend import Backend, Samples, Size

Frames = NDArray[np.uint8]  #: (F, H, W, 3) RGB
Picture = NDArray[np.uint8]  #: (H, W, 3) RGB
Moving = NDArray[np.bool_]  #: (H, W) where the source moves

#: Shorter side below which frames are not halved, px.
_LEAST_SIDE = 128


@dataclass(frozen=True, slots=True, eq=False)
class Footage:
    """Frames of one GOP."""

    frames: Frames  #: (F, H, W, 3) RGB
    taus: Float32Array  #: (F,) normalised times
    background: Gop | None = None  #: static Gaussians drawn behind the fitted ones
    moving: Moving | None = None  #: None = everywhere

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, pixels."""
        return self.frames.shape[2], self.frames.shape[1]

    @property
    def pixels(self) -> int:
        """Pixels of all frames."""
        return self.frames[..., 0].size


def backdrop(
    background: Gop | None, size: Size, coded_size: Size, backend: Backend
) -> Samples | None:
    """Return the sums of a background and of the plate, (H, W, 4), where the backend adds them.

    None where there is neither.

    Args:
        background: static Gaussians; None = none.
        size: width and height to draw at.
        coded_size: width and height that scales are relative to.
        backend: draws.
    """
    if background is None:
        return backend.behind(size)
    prepared = backend.prepare(background)
    return backend.upload(backend.sums(prepared, 0.0, size, coded_size))


def halved(frames: Frames) -> Frames:
    """Return frames of half the size; small ones as they are."""
    height, width = frames.shape[1:3]
    if min(height, width) < _LEAST_SIDE:
        return frames
    size = (width // 2, height // 2)
    return np.stack([cv2.resize(f, size, interpolation=cv2.INTER_AREA) for f in frames])


def some_frames(frames: int, count: int) -> NDArray[np.intp]:
    """Return numbers of at most `count` frames, spread evenly from the first to the last."""
    return np.unique(np.linspace(0, frames - 1, count).round().astype(np.intp))
