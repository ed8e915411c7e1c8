"""What is not worth its bits is not stored: small motion, opacities near 1, small changes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.fit.anchor import LOOK
from gsvrcodec.fit.precision import bit_worth
from gsvrcodec.fit.tuned import PREDICTION, STEPS
from gsvrcodec.model.gop import Gop
from gsvrcodec.model.quantise import Steps


def still(gop: Gop) -> Gop:
    """Return the Gaussians without their motion: no polynomial, and no tri-plane."""
    return replace(
        gop,
        indicator=np.ones_like(gop.indicator),
        linear=np.zeros_like(gop.linear),
        quadratic=np.zeros_like(gop.quadratic),
    )


def with_static(gop: Gop, sensitivities: Sequence[Gop], qscale: float) -> Gop:
    """Make the Gaussians static whose motion is worth less than the bits of that motion.

    A static Gaussian has no polynomial motion and the indicator 1, which switches the tri-plane
    off.

    Args:
        gop: The GOP to be stored.
        sensitivities: Squared error of a change of each parameter by one, in several states of the
            GOP of which the worst counts; see `sensitivities`.
        qscale: Factor of the steps that the GOP will be stored with.
    """
    losses = [
        (own.linear * np.square(gop.linear)).sum(axis=1)
        + (own.quadratic * np.square(gop.quadratic)).sum(axis=1)
        + own.indicator * np.square(1 - gop.indicator)
        for own in sensitivities
    ]
    moves = np.max(losses, axis=0) >= STEPS.static_worth * qscale**2
    static = still(gop)
    return replace(
        gop,
        indicator=np.where(moves, gop.indicator, static.indicator),
        linear=np.where(moves[:, None], gop.linear, static.linear),
        quadratic=np.where(moves[:, None], gop.quadratic, static.quadratic),
    )


def with_usual_opacity(gop: Gop, new: NDArray[np.bool_], sensitivities: Gop, qscale: float) -> Gop:
    """Give the opacity 1 to new Gaussians whose opacity is worth less than its bits.

    Args:
        gop: The GOP to be stored.
        new: (N,) Gaussians that do not come from a reference.
        sensitivities: Squared error of a change of each parameter by one.
        qscale: Factor of the steps that the GOP will be stored with.
    """
    loss = sensitivities.log_opacity * np.square(gop.log_opacity)
    usual = new & (loss < STEPS.opacity_bits * bit_worth(qscale))
    return replace(gop, log_opacity=np.where(usual, np.float32(0), gop.log_opacity))


def with_unchanged(
    stored: Gop, carried: NDArray[np.bool_], sensitivities: Gop, steps: Steps, qscale: float
) -> Gop:
    """Undo the changes of carried Gaussians that are worth less than their bits.

    Args:
        stored: The GOP to be stored, relative to its anchor.
        carried: (N,) Gaussians of the reference.
        sensitivities: Squared error of a change of each parameter by one.
        steps: Quantiser steps.
        qscale: Factor of the steps.
    """
    loss, bits = np.zeros(len(stored)), np.full(len(stored), PREDICTION.change_bits)
    for name in LOOK:
        change = getattr(stored, name).reshape(len(stored), -1)
        loss += (getattr(sensitivities, name).reshape(change.shape) * np.square(change)).sum(axis=1)
        bits += np.log2(1 + np.abs(change) / np.array(steps[name])).sum(axis=1)
    undone = carried & (loss < PREDICTION.undone * bits * bit_worth(qscale))
    changes = {}
    for name in LOOK:
        value = getattr(stored, name).copy()
        value[undone] = 0
        changes[name] = value
    return replace(stored, **changes)
