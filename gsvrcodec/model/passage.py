"""Passage: pictures between a GOP and the next that is predicted from it (spec section "Time")."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.model.gop import Float32Array, Gop
from gsvrcodec.model.prediction import Look, first_look, last_look
from gsvrcodec.model.reconstruction import Blending
from gsvrcodec.model.static import static_gop


@dataclass(frozen=True, slots=True, eq=False)
class Passage:
    """The way of each Gaussian from the last frame of a GOP to the first frame of the next.

    In the order of the Gaussians of the next GOP; behind them those that it drops.
    """

    start: Look  #: at the last frame; new Gaussians as at the first frame of the next GOP
    stop: Look  #: at the first frame of the next GOP; dropped ones as at the last frame
    new: slice  #: Gaussians that come
    dropped: slice  #: Gaussians that go
    blending: Blending  #: how pictures are formed

    @classmethod
    def of(
        cls,
        before: Gop,
        after: Gop,
        kept: NDArray[np.bool_],
        frames: tuple[int, int],
        blending: Blending = "mean",
    ) -> Self:
        """Return the passage between two GOPs.

        Args:
            before: The reference; M Gaussians.
            after: The GOP that is predicted from it; first the Gaussians that it takes over.
            kept: Shape (M,), which Gaussians of the reference it takes over.
            frames: Frames of both GOPs.
            blending: How pictures are formed.
        """
        last = last_look(before, frames[0], blending)
        first = first_look(after, frames[1], blending)
        carried = np.count_nonzero(kept)
        gone = last[~kept]
        return cls(
            _joined(last[kept], first[carried:], gone),
            _joined(first, gone),
            slice(carried, len(after)),
            slice(len(after), None),
            blending,
        )

    def at(self, weight: float) -> Gop:
        """Return the Gaussians at a moment, `weight` 0 to 1 of the way, as a static GOP.

        Gaussians that come or go have a share of their opacities; of their colours where pictures
        are sums.
        """
        gop = static_gop(
            _mixed(self.start.position, self.stop.position, weight),
            _mixed(self.start.log_scale, self.stop.log_scale, weight),
            _mixed(self.start.rotation, self.stop.rotation, weight),
            _mixed(self.start.colour, self.stop.colour, weight),
            _mixed(self.start.log_opacity, self.stop.log_opacity, weight),
        )
        for part, share in ((self.new, weight), (self.dropped, 1 - weight)):
            if self.blending == "sum":
                gop.colour[part] *= np.float32(share)
            else:
                gop.log_opacity[part] += np.float32(math.log(max(share, _LEAST_SHARE)))
        return gop


#: Least share of an opacity.
_LEAST_SHARE = 2.0**-16


def _joined(*looks: Look) -> Look:
    return Look(
        np.concatenate([look.position for look in looks]),
        np.concatenate([look.log_scale for look in looks]),
        np.concatenate([look.rotation for look in looks]),
        np.concatenate([look.colour for look in looks]),
        np.concatenate([look.log_opacity for look in looks]),
    )


def _mixed(start: Float32Array, stop: Float32Array, weight: float) -> Float32Array:
    """Return (1 - weight) start + weight stop, exact at both ends."""
    share = np.float32(weight)
    return np.asarray(start * (np.float32(1) - share) + stop * share, np.float32)
