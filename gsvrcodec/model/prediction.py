"""Prediction: a GOP takes Gaussians over from an earlier one (spec section "Prediction").

The earlier GOP is the reference. Each of its Gaussians goes on from where and as it is drawn in the
last frame of the reference.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.model.gop import Float32Array, Gop, clip_to_bounds
from gsvrcodec.model.reconstruction import MIN_SCALE, MOST_LOG_OPACITY, Blending

#: Bits of a mode. Neither: the Gaussian is kept as it is and stands still.
MOVED = 1  #: it has an indicator and a motion
CHANGED = 2  #: position, scales, rotation and colour change
#: The mode of a Gaussian that the GOP does not take over.
DROPPED = 4

Modes = NDArray[np.uint8]

#: Gaussians at a time, so that their offsets stay in the cache.
_BLOCK = 2048

_LOOK = ("position", "log_scale", "rotation", "colour", "log_opacity")
_MOTION = ("indicator", "linear", "quadratic")


@dataclass(frozen=True, slots=True, eq=False)
class Carried:
    """What a predicted GOP stores of the Gaussians of its reference."""

    mode: Modes  #: (M,) of each Gaussian of the reference
    # Changes of the C Gaussians with the bit CHANGED, in the order of the reference.
    position: Float32Array  #: (C, 2) the frame spans [-1, 1]
    log_scale: Float32Array  #: (C, 2)
    rotation: Float32Array  #: (C,) radians
    colour: Float32Array  #: (C, 3)
    log_opacity: Float32Array  #: (C,)
    # Motion of the V Gaussians with the bit MOVED, in the order of the reference.
    indicator: Float32Array  #: (V,)
    linear: Float32Array  #: (V, 2)
    quadratic: Float32Array  #: (V, 2)

    @property
    def kept(self) -> int:
        """Number of Gaussians that the GOP takes over."""
        return int(np.count_nonzero(self.mode != DROPPED))


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """Gaussians as drawn at one moment: N of them."""

    position: Float32Array  #: (N, 2) centre; the frame spans [-1, 1]
    log_scale: Float32Array  #: (N, 2) natural logarithm of sigma in pixels of the coded frame
    rotation: Float32Array  #: (N,) radians
    colour: Float32Array  #: (N, 3)
    log_opacity: Float32Array  #: (N,)

    def __getitem__(self, chosen: NDArray[np.intp] | NDArray[np.bool_] | slice) -> Look:
        """Select Gaussians."""
        return Look(
            self.position[chosen],
            self.log_scale[chosen],
            self.rotation[chosen],
            self.colour[chosen],
            self.log_opacity[chosen],
        )


def look_at(gop: Gop, tau: float, blending: Blending = "mean") -> Look:
    """Return the Gaussians as drawn at a time.

    Args:
        gop: N Gaussians and their deformation.
        tau: Normalised time, -1 to 1.
        blending: How pictures are formed.

    Returns:
        New arrays, which share no memory with `gop`.
    """
    position = gop.position.astype(np.float64)
    position += tau * gop.linear.astype(np.float64)
    position += tau * tau * gop.quadratic.astype(np.float64)
    log_scale, rotation, colour = gop.log_scale.copy(), gop.rotation.copy(), gop.colour.copy()
    log_opacity = gop.log_opacity.copy()
    if gop.xy.size:
        bent = np.flatnonzero(gop.indicator != 1)
        for first in range(0, len(bent), _BLOCK):
            some = bent[first : first + _BLOCK]
            strength = 1 - gop.indicator[some, None].astype(np.float64)
            # Read by `np.take`: many times as fast as an index.
            offset = strength * _triplane(gop, np.take(gop.position, some, 0), tau)
            position[some] = np.take(position, some, 0) + offset[:, :2]
            scale = np.exp(np.take(log_scale, some, 0).astype(np.float64)) + offset[:, 2:4]
            log_scale[some] = np.log(np.maximum(scale, MIN_SCALE))
            rotation[some] = np.take(rotation, some) + offset[:, 4]
            if blending == "sum":
                colour[some] = np.take(colour, some, 0) + offset[:, 5:]
            else:
                opacity = np.take(log_opacity, some) + offset[:, 5]
                log_opacity[some] = np.clip(opacity, -MOST_LOG_OPACITY, MOST_LOG_OPACITY)
    return Look(position.astype(np.float32), log_scale, rotation, colour, log_opacity)


def last_look(gop: Gop, frames: int, blending: Blending = "mean") -> Look:
    """Return the Gaussians of a GOP of so many frames as drawn at its last frame."""
    return look_at(gop, 1.0 if frames > 1 else 0.0, blending)


def first_look(gop: Gop, frames: int, blending: Blending = "mean") -> Look:
    """Return the Gaussians of a GOP of so many frames as drawn at its first frame."""
    return look_at(gop, -1.0 if frames > 1 else 0.0, blending)


def start_of_motion(frames: int) -> float:
    """Return the time at which carried Gaussians of a GOP of so many frames begin to move.

    That is one mean frame before its first frame, when the last frame of the reference is shown.
    """
    return -1 - 2 / (frames - 1) if frames > 1 else -1.0


def carry_over(
    reference: Gop,
    frames: tuple[int, int],
    carried: Carried,
    new: Gop,
    blending: Blending = "mean",
) -> Gop:
    """Return a predicted GOP.

    Args:
        reference: The GOP that it is predicted from; M Gaussians.
        frames: Frames of the reference, and of the GOP.
        carried: How its Gaussians go on.
        new: The GOP's other Gaussians, and its tri-plane.
        blending: How pictures are formed.

    Returns:
        The Gaussians that are not dropped, in the order of the reference, and the new ones; each
        value within the bounds of its attribute.
    """
    mode = carried.mode
    look = last_look(reference, frames[0], blending)
    changed = np.flatnonzero(mode & CHANGED)
    moved = np.flatnonzero(mode & MOVED)
    values: dict[str, Float32Array] = {name: getattr(look, name) for name in _LOOK}
    for name, value in values.items():
        value[changed] = np.take(value, changed, 0) + getattr(carried, name)
        clip_to_bounds(name, value)
    # The motion begins where the reference ends, plus the change.
    start = start_of_motion(frames[1])
    way = start * carried.linear.astype(np.float64) + start**2 * carried.quadratic
    values["position"][moved] = np.take(values["position"], moved, 0) - way
    clip_to_bounds("position", values["position"])
    count = len(mode)
    values["indicator"] = np.ones(count, np.float32)
    values["linear"] = np.zeros((count, 2), np.float32)
    values["quadratic"] = np.zeros((count, 2), np.float32)
    for name in _MOTION:
        values[name][moved] = getattr(carried, name)
    kept = np.flatnonzero(mode != DROPPED)
    both = {
        name: np.concatenate([np.take(value, kept, 0), getattr(new, name)])
        for name, value in values.items()
    }
    return replace(new, **both)


def _triplane(gop: Gop, position: Float32Array, tau: float) -> NDArray[np.float64]:
    """Look the tri-plane up at positions (N, 2) and one time, (N, 8)."""
    x, y = position.astype(np.float64).T
    rows, columns, _ = gop.xy.shape
    x0, x1, fx = _cell(x, columns)
    y0, y1, fy = _cell(y, rows)
    flat = gop.xy.reshape(rows * columns, -1).astype(np.float64)
    top = _between(flat, y0 * columns + x0, y0 * columns + x1, fx)
    offset = _between(flat, y1 * columns + x0, y1 * columns + x1, fx)
    offset *= fy
    offset += top * (1 - fy)
    (t0,), (t1,), ((ft,),) = _cell(np.array([tau]), len(gop.xt))
    along_x = gop.xt[t0].astype(np.float64) * (1 - ft) + gop.xt[t1] * ft
    along_y = gop.yt[t0].astype(np.float64) * (1 - ft) + gop.yt[t1] * ft
    offset *= _between(along_x, x0, x1, fx)
    offset *= _between(along_y, y0, y1, fy)
    return offset


def _between(
    rows: NDArray[np.float64],
    low: NDArray[np.intp],
    high: NDArray[np.intp],
    fraction: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Interpolate between rows of a table."""
    value = np.take(rows, low, 0)
    value *= 1 - fraction
    upper = np.take(rows, high, 0)
    upper *= fraction
    value += upper
    return value


def _cell(
    at: NDArray[np.float64], size: int
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.float64]]:
    """Return the grid points before and behind positions in [-1, 1], and the fraction between."""
    u = np.clip((at + 1) / 2 * (size - 1), 0, size - 1)
    low = u.astype(np.intp)
    return low, np.minimum(low + 1, size - 1), (u - low)[:, None]
