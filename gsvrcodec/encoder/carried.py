"""From a predicted fit to what its GOP stores of the reference, and what is new."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.fit.anchor import LOOK
from gsvrcodec.fit.fitting import Fit
from gsvrcodec.model.gop import Float32Array, Gop
from gsvrcodec.model.prediction import CHANGED, DROPPED, MOVED, Carried
from gsvrcodec.model.quantise import Precision
from gsvrcodec.model.static import select_gaussians


def carried_of(fit: Fit, gop: Gop, precision: Precision) -> Carried | None:
    """Return how the Gaussians of the reference go on; None for a key GOP.

    A Gaussian whose changes round to nothing has none, and so has a motion.

    Args:
        fit: a predicted fit.
        gop: its Gaussians as they are to be stored.
        precision: quantiser steps.
    """
    if fit.anchor is None or fit.kept is None:
        return None
    numbers = np.flatnonzero(fit.anchor.carried)
    numbers = numbers[np.argsort(fit.anchor.source[numbers])]
    gop = select_gaussians(gop, numbers)
    half = np.pi / 2
    values = {name: getattr(gop, name) for name in LOOK}
    values["rotation"] = (values["rotation"] + half) % np.pi - half

    def rounds_to_nothing(name: str, value: Float32Array) -> NDArray[np.bool_]:
        columns = value if value.ndim > 1 else value[:, None]
        return np.asarray(~np.rint(columns / np.array(precision[name])).any(axis=1))

    changed = ~np.logical_and.reduce([rounds_to_nothing(n, v) for n, v in values.items()])
    moving = {"linear": gop.linear, "quadratic": gop.quadratic, "indicator": 1 - gop.indicator}
    moved = ~np.logical_and.reduce([rounds_to_nothing(n, v) for n, v in moving.items()])
    mode = np.where(fit.kept, 0, DROPPED).astype(np.uint8)
    mode[fit.anchor.source[numbers]] = MOVED * moved + CHANGED * changed
    return Carried(
        mode,
        **{name: values[name][changed] for name in LOOK},
        **{name: getattr(gop, name)[moved] for name in ("indicator", "linear", "quadratic")},
    )


def new_of(fit: Fit, gop: Gop) -> Gop:
    """Return the Gaussians of a fit that do not come from the reference, and the tri-plane."""
    return gop if fit.anchor is None else select_gaussians(gop, ~fit.anchor.carried)
