"""Gaussians that hardly move, made to stand still: fewer bits, and drawn once a GOP."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gsvrcodec.model.gop import Gop

#: Squared 8-bit codes that a Gaussian's motion may be worth at factor 1: what some ten bits buy
#: elsewhere, at the slope of the steps (2 ln 2 times their unit of 100 for each).
_WORTH = 1500.0


def with_still(gop: Gop, changes: Gop, factor: float) -> Gop:
    """The same GOP, but Gaussians whose motion is worth less than its bits stand still.

    They lose their polynomial, and the dynamic indicator keeps the tri-plane from them.

    Args:
        gop: What is to be stored.
        changes: Squared error of a change by one, as `sensitivity` measures it.
        factor: Of the steps that it will be stored in.
    """
    loss = (
        (changes.linear * np.square(gop.linear)).sum(axis=1)
        + (changes.quadratic * np.square(gop.quadratic)).sum(axis=1)
        + changes.indicator * np.square(1 - gop.indicator)
    )
    moves = loss >= _WORTH * factor**2
    return replace(
        gop,
        indicator=np.where(moves, gop.indicator, np.float32(1)),
        linear=gop.linear * moves[:, None],
        quadratic=gop.quadratic * moves[:, None],
    )
