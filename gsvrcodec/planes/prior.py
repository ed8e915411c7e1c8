"""The planes of a grid as they come: codec 4 refers to those before the one at hand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.native import _entropy
from gsvrcodec.planes.samples import Samples


@dataclass(frozen=True, slots=True, eq=False)
class PriorPlanes:
    """The planes of one grid that stand before a plane."""

    planes: NDArray[np.uint16]  #: (count, height, width)
    columns: Samples | None = None  #: (height, width), see `PlaneStack`; None = as without

    @classmethod
    def none(cls, height: int, width: int) -> PriorPlanes:
        """What the first plane of a grid has."""
        return cls(np.empty((0, height, width), np.uint16))


class PlaneStack:
    """Collects the planes of one grid."""

    def __init__(self, count: int, height: int, width: int, *, guided: bool = False):
        """Make room.

        Args:
            count: Planes of the grid.
            height: Rows of each.
            width: Samples in a row.
            guided: Whether the first plane tells which samples of neighbouring rows belong
                together: each goes with the last one of the row above that is not larger, by the
                first plane (spec section "Codec 4").
        """
        self._planes = np.empty((count, height, width), np.uint16)
        self._count = 0
        self._guided = guided
        self._columns: Samples | None = None

    @property
    def prior(self) -> PriorPlanes:
        """The planes so far."""
        return PriorPlanes(self._planes[: self._count], self._columns)

    def append(self, samples: Samples) -> None:
        """Add the next plane."""
        self._planes[self._count] = samples
        self._count += 1
        if self._guided and self._count == 1:
            self._columns = np.empty(samples.shape, np.uint16)
            _entropy.follow(self._planes[0], self._columns)
