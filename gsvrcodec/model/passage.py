"""Passage: pictures between a GOP and the next that is predicted from it (spec section "Time")."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.model.gop import Float32Array, Gop
from gsvrcodec.model.prediction import Look, first_look, last_look
from gsvrcodec.model.static import static_gop


@dataclass(frozen=True, slots=True, eq=False)
class Passage:
    """The way of each Gaussian from the last frame of a GOP to the first frame of the next.

    In the order of the Gaussians of the next GOP; behind them those that it drops.
    """

    start: Look  #: at the last frame; Gaussians that are not there yet are black
    stop: Look  #: at the first frame of the next GOP; Gaussians that are gone are black

    @classmethod
    def of(cls, before: Gop, after: Gop, kept: NDArray[np.bool_], frames: tuple[int, int]) -> Self:
        """Return the passage between two GOPs.

        Args:
            before: The reference; M Gaussians.
            after: The GOP that is predicted from it; first the Gaussians that it takes over.
            kept: Shape (M,), which Gaussians of the reference it takes over.
            frames: Frames of both GOPs.
        """
        last, first = last_look(before, frames[0]), first_look(after, frames[1])
        new, dropped = first[np.count_nonzero(kept) :], last[~kept]
        return cls(
            _joined(last[kept], _black(new), dropped),
            _joined(first, _black(dropped)),
        )

    def at(self, weight: float) -> Gop:
        """Return the Gaussians at a moment, `weight` 0 to 1 of the way, as a static GOP."""
        return static_gop(
            _mixed(self.start.position, self.stop.position, weight),
            _mixed(self.start.log_scale, self.stop.log_scale, weight),
            _mixed(self.start.rotation, self.stop.rotation, weight),
            _mixed(self.start.colour, self.stop.colour, weight),
        )


def _black(look: Look) -> Look:
    """Return the Gaussians with colour 0, so that they cannot be seen."""
    return replace(look, colour=np.zeros_like(look.colour))


def _joined(*looks: Look) -> Look:
    return Look(
        np.concatenate([look.position for look in looks]),
        np.concatenate([look.log_scale for look in looks]),
        np.concatenate([look.rotation for look in looks]),
        np.concatenate([look.colour for look in looks]),
    )


def _mixed(start: Float32Array, stop: Float32Array, weight: float) -> Float32Array:
    """Return (1 - weight) start + weight stop, exact at both ends."""
    share = np.float32(weight)
    return np.asarray(start * (np.float32(1) - share) + stop * share, np.float32)
