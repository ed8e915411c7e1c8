"""Shape of a plane and width of its samples, shared by all plane codecs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.errors import CorruptError

Samples = NDArray[np.uint16]
#: Samples as image codecs store them: uint8 up to 8 bits, else uint16.
StoredSamples = NDArray[np.unsignedinteger]

MAX_BITS = 16


@dataclass(frozen=True, slots=True)
class PlaneShape:
    """Width, height and bit depth of a plane."""

    width: int  #: samples in a row, at least 1
    height: int  #: rows, at least 1
    bits: int  #: every sample is less than 2**bits; 1 to 16

    @property
    def samples(self) -> int:
        """Samples in the plane."""
        return self.width * self.height

    @property
    def stored_bytes(self) -> int:
        """Bytes of a stored sample: 1 up to 8 bits, else 2."""
        return 1 if self.bits <= 8 else 2

    @property
    def dtype(self) -> type[np.uint8] | type[np.uint16]:
        """Type of a stored sample."""
        return np.uint8 if self.bits <= 8 else np.uint16

    def empty(self) -> StoredSamples:
        """An uninitialised array of stored samples, shape (height, width)."""
        return np.empty((self.height, self.width), self.dtype)


def checked(samples: StoredSamples, shape: PlaneShape) -> Samples:
    """Return decoded samples as uint16.

    Raises:
        CorruptError: A sample does not fit into the declared bits.
    """
    if shape.bits < 8 * shape.stored_bytes and int(samples.max()) >= 1 << shape.bits:
        raise CorruptError(f"sample {int(samples.max())} in a plane of {shape.bits} bits")
    return samples.astype(np.uint16, copy=False)
