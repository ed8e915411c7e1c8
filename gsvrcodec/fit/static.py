"""Gaussians that hardly move are made static: they take fewer bits and are drawn once a GOP."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gsvrcodec.fit.tuned import STEPS
from gsvrcodec.model.gop import Gop


def with_static(gop: Gop, sensitivities: Gop, qscale: float) -> Gop:
    """Make the Gaussians static whose motion is worth less than the bits of that motion.

    A static Gaussian has no polynomial motion and the indicator 1, which switches the tri-plane
    off.

    Args:
        gop: The GOP to be stored.
        sensitivities: Squared error of a change of each parameter by one; see `sensitivities`.
        qscale: Factor of the steps that the GOP will be stored with.
    """
    loss = (
        (sensitivities.linear * np.square(gop.linear)).sum(axis=1)
        + (sensitivities.quadratic * np.square(gop.quadratic)).sum(axis=1)
        + sensitivities.indicator * np.square(1 - gop.indicator)
    )
    moves = loss >= STEPS.static_worth * qscale**2
    return replace(
        gop,
        indicator=np.where(moves, gop.indicator, np.float32(1)),
        linear=gop.linear * moves[:, None],
        quadratic=gop.quadratic * moves[:, None],
    )
