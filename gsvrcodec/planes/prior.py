"""Prior planes: planes of the same grid that stand earlier in the table, for codec 4."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.native import _entropy
from gsvrcodec.planes.samples import Samples


@dataclass(frozen=True, slots=True, eq=False)
class PriorPlanes:
    """The prior planes of a plane."""

    planes: NDArray[np.uint16]  #: (count, height, width)
    #: (height, width), column of the neighbour above, see `PlaneStack`; None = the same column
    columns: Samples | None = None

    @classmethod
    def none(cls, height: int, width: int) -> PriorPlanes:
        """No prior planes: for the first plane of a grid."""
        return cls(np.empty((0, height, width), np.uint16))


class PlaneStack:
    """Collects the planes of one grid in table order."""

    def __init__(self, count: int, height: int, width: int, *, guided: bool = False):
        """Allocate the planes.

        Args:
            count: Planes of the grid.
            height: Rows of a plane.
            width: Samples in a row.
            guided: Whether the first plane chooses the neighbour above of each sample: the last
                sample of the row above that is not larger in the first plane (spec section
                "Codec 4").
        """
        self._planes = np.empty((count, height, width), np.uint16)
        self._count = 0
        self._guided = guided
        self._columns: Samples | None = None

    @property
    def prior(self) -> PriorPlanes:
        """The planes added so far."""
        return PriorPlanes(self._planes[: self._count], self._columns)

    def append(self, samples: Samples) -> None:
        """Add the next plane."""
        self._planes[self._count] = samples
        self._count += 1
        if self._guided and self._count == 1:
            self._columns = np.empty(samples.shape, np.uint16)
            _entropy.follow(self._planes[0], self._columns)
