"""Fine-tuning under quantisation: attributes are rounded one after another, the rest follow."""

from __future__ import annotations

import numpy as np

from gsvrcodec.fit.field import Field, squared_error
from gsvrcodec.fit.optimise import Adam, Effort, Frames, Recipe, visits
from gsvrcodec.fit.options import Deform
from gsvrcodec.model.gop import Float32Array, Gop
from gsvrcodec.model.quantise import Precision, dequantised

#: What is rounded together, in this order; what is named nowhere, the colours, comes last.
_STAGES = (
    ("indicator", "linear", "quadratic", "xy", "xt", "yt"),
    ("position",),
    ("log_scale", "rotation"),
)
#: Of the recipe's rates, at the beginning of each stage; they fall to nothing.
_GENTLE = 0.05


def settle(
    stored: Gop,
    precision: Precision,
    frames: Frames,
    taus: Float32Array,
    recipe: Recipe,
    steps: int,
    seconds: float | None,
    rng: np.random.Generator,
    *,
    deform: Deform = "hybrid",
    device: str = "cpu",
    threads: int = 0,
    still: Gop | None = None,
) -> Gop:
    """Return `stored` with all but the colours rounded, and colours that make up for it.

    Gaussians overlap, so that what rounding one attribute does to the picture can be undone, in
    part, by those that are still free. It leaves three fifths of the loss, for bits as before.

    Args:
        stored: what would be stored otherwise.
        precision: what it will be stored in.
        frames: (F, H, W, 3) uint8.
        taus: (F,) their normalised times.
        recipe: rates of the fit.
        steps: how many to take, if it does not go by time.
        seconds: wall time to spend; None = by steps.
        rng: order of the frames.
        deform: the deformation field.
        device: what renders.
        threads: native threads.
        still: what is drawn behind it.
    """
    size = frames.shape[2], frames.shape[1]
    field = Field(stored, deform, device, still)
    targets, order = field.uploaded(frames), visits(len(frames), rng)
    backdrop = field.backdrop(size, size, threads)
    each = max(1, steps // len(_STAGES)), None if seconds is None else seconds / len(_STAGES)
    for stage in _STAGES:
        rounded = dequantised(stored, precision)
        field.fix({name: getattr(rounded, name) for name in stage})
        adam, effort = Adam(field.raw, recipe, size, threads), Effort(*each)
        while (spent := effort.spent) < 1.0:
            index = next(order)
            loss = squared_error(
                field.tensors(), float(taus[index]), targets[index], size, threads, backdrop
            )
            loss.backward()  # type: ignore[no-untyped-call]
            adam.step(_GENTLE * (1 - spent))
            effort.advance()
        stored = field.gop()
    return stored
