"""Prediction: a GOP takes Gaussians over from an earlier one (spec section "Prediction").

The earlier GOP is the reference. Each of its Gaussians goes on from where and as it is drawn in the
last frame of the reference.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.model.attributes import ATTRIBUTES
from gsvrcodec.model.gop import Float32Array, Gop, parameters_of
from gsvrcodec.model.reconstruction import Blending
from gsvrcodec.model.static import GAUSSIAN_ATTRIBUTES, resized
from gsvrcodec.native import _core

#: Bits of a mode. Neither: the Gaussian is kept as it is and stands still.
MOVED = 1  #: it has an indicator and a motion
CHANGED = 2  #: position, scales, rotation and colour change
#: The mode of a Gaussian that the GOP does not take over.
DROPPED = 4

Modes = NDArray[np.uint8]

_LOOK = ("position", "log_scale", "rotation", "colour", "log_opacity")
#: Least and greatest value of each attribute of a look.
_BOUNDS = np.array([[a.low, a.high] for a in ATTRIBUTES if a.name in _LOOK], np.float32)


@dataclass(frozen=True, slots=True, eq=False)
class Carried:
    """What a predicted GOP stores of the Gaussians of its reference; arrays are C-contiguous."""

    mode: Modes  #: (M,) of each Gaussian of the reference
    # Changes of the C Gaussians with the bit CHANGED, in the order of the reference, in units of
    # `change_units`.
    position: Float32Array  #: (C, 2)
    log_scale: Float32Array  #: (C, 2)
    rotation: Float32Array  #: (C,)
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
    look = Look(*(np.empty_like(getattr(gop, name)) for name in _LOOK))
    _core.look_at(parameters_of(gop), tau, blending == "mean", arrays_of(look))
    return look


def change_units(look: Look) -> Look:
    """Return what a stored change of 1 adds to each value of a look.

    It follows from the size, the shape and the opacity of the Gaussian: a large one may be off by
    more in its place, a slender one by less in its rotation.
    """
    units = Look(*(np.empty_like(getattr(look, name)) for name in _LOOK))
    _core.change_units(arrays_of(look), arrays_of(units))
    return units


def last_time(frames: int) -> float:
    """Return the time of the last frame of a GOP of so many frames."""
    return 1.0 if frames > 1 else 0.0


def last_look(gop: Gop, frames: int, blending: Blending = "mean") -> Look:
    """Return the Gaussians of a GOP of so many frames as drawn at its last frame."""
    return look_at(gop, last_time(frames), blending)


def first_look(gop: Gop, frames: int, blending: Blending = "mean") -> Look:
    """Return the Gaussians of a GOP of so many frames as drawn at its first frame."""
    return look_at(gop, -last_time(frames), blending)


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
    kept = carried.kept
    whole = resized(new, kept + len(new))
    end, start = last_time(frames[0]), start_of_motion(frames[1])
    motion = carried.indicator, carried.linear, carried.quadratic
    how = carried.mode, arrays_of(carried), *motion, start, _BOUNDS
    _core.carry_over(parameters_of(reference), end, blending == "mean", *how, parameters_of(whole))
    for name in GAUSSIAN_ATTRIBUTES:
        getattr(whole, name)[kept:] = getattr(new, name)
    return whole


def arrays_of(look: Look | Carried) -> _core.Look:
    """Return the core's view of a look, or of the changes of one: no copy."""
    return _core.Look(*(getattr(look, name) for name in _LOOK))
