"""Gaussians that hardly move, made to stand still: fewer bits, and drawn once a GOP."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gsvrcodec.fit.tuned import STEPS
from gsvrcodec.model.gop import Gop


def with_static(gop: Gop, sensitivities: Gop, qscale: float) -> Gop:
    """The same GOP, but Gaussians whose motion is worth less than its bits stand still.

    They lose their polynomial, and the dynamic indicator keeps the tri-plane from them.

    Args:
        gop: What is to be stored.
        sensitivities: Squared error of a change by one, as `sensitivity` measures it.
        qscale: Of the steps that it will be stored in.
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
