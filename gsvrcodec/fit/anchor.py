"""The anchor of a predicted fit: where the reference leaves the Gaussians that a GOP carries on."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from gsvrcodec.model.gop import Float32Array, Gop
from gsvrcodec.model.prediction import Look

#: Attributes that a predicted GOP stores as changes.
LOOK = ("position", "log_scale", "rotation", "colour", "log_opacity")


@dataclass(slots=True, eq=False)
class Anchor:
    """What N stored Gaussians are relative to; new ones are relative to nothing.

    A carried Gaussian stores the change of its look at the time `start`; its canonical position
    follows from that and its motion (spec section "Prediction").
    """

    start: float  #: when carried Gaussians begin to move, in units of tau
    look: Look  #: (N, ...), zeros where new
    source: NDArray[np.intp]  #: (N,) number of the Gaussian in the reference; -1 = new

    @property
    def carried(self) -> NDArray[np.bool_]:
        """Which Gaussians come from the reference, (N,)."""
        return self.source >= 0

    def gop(self, stored: Gop) -> Gop:
        """Return the Gaussians that stored values stand for."""
        values = {name: getattr(stored, name) + getattr(self.look, name) for name in LOOK}
        values["position"] = values["position"] - self._way(stored)
        return replace(stored, **values)

    def stored(self, gop: Gop) -> Gop:
        """Return the stored values of Gaussians."""
        values = {
            **{name: getattr(gop, name) for name in LOOK},
            "position": gop.position + self._way(gop),
        }
        return replace(gop, **{name: v - getattr(self.look, name) for name, v in values.items()})

    def _way(self, gop: Gop) -> Float32Array:
        """Motion at the time `start`, (N, 2); zeros where new."""
        way = np.float32(self.start) * gop.linear + np.float32(self.start**2) * gop.quadratic
        return np.asarray(self.carried[:, None] * way, np.float32)

    def rearrange(self, order: NDArray[np.intp]) -> None:
        """Put the Gaussians into another order."""
        self.look, self.source = self.look[order], self.source[order]

    def release(self, chosen: NDArray[np.intp]) -> None:
        """Make Gaussians new."""
        self.source[chosen] = -1
        for name in LOOK:
            getattr(self.look, name)[chosen] = 0

    def copy(self) -> Anchor:
        """Return an anchor of its own arrays."""
        return Anchor(self.start, self.look[np.arange(len(self.source))], self.source.copy())

    def tensors(self, device: str) -> dict[str, torch.Tensor]:
        """The look on a device, and "carried", 1 or 0, (N, 1)."""
        out = {name: torch.from_numpy(getattr(self.look, name)).to(device) for name in LOOK}
        carried: Float32Array = self.carried[:, None].astype(np.float32)
        return out | {"carried": torch.from_numpy(carried).to(device)}
