from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

# Planes are (height, width) arrays. In all functions, `prior` is (count, height, width): the prior
# planes; `columns` is (height, width) or None: the result of `follow`.

class Predictor:
    """The linear prediction of a sample in codec 4; the spec has the units and bounds."""

    def __init__(
        self,
        terms: Sequence[tuple[int, int]],
        bias: int,
        guided: bool,
        weights: Sequence[int],
    ) -> None:
        """Set the weights of (prior plane, weight) `terms` and of the six neighbours."""

class Coding:
    """The parameters of the entropy coder in codec 4."""

    def __init__(self, direct: int, top: int, thresholds: Sequence[int]) -> None:
        """Set how errors are divided into tokens, and the bounds of the contexts."""

def follow(guide: NDArray[np.uint16], columns: NDArray[np.uint16]) -> None:
    """Write to `columns`, for each sample, the column of the row above that the sample follows."""

def predict(
    samples: NDArray[np.uint16],
    bits: int,
    prior: NDArray[np.uint16],
    columns: NDArray[np.uint16] | None,
    predictor: Predictor,
    errors: NDArray[np.int32],
    around: NDArray[np.uint32],
) -> None:
    """Write the errors of the prediction, and for each sample the weighted errors around it."""

def measure(errors: NDArray[np.int32], around: NDArray[np.uint32], coding: Coding) -> float:
    """Return the size in bits of a stream with these errors, without its predictor."""

def encode_context(
    samples: NDArray[np.uint16],
    bits: int,
    prior: NDArray[np.uint16],
    columns: NDArray[np.uint16] | None,
    predictor: Predictor,
    coding: Coding,
) -> bytes:
    """Encode a plane with codec 4."""

def encode_ranges(samples: NDArray[np.uint16]) -> bytes:
    """Encode a plane with codec 5."""

def decode_planes(
    data: bytes,
    planes: Sequence[tuple[int, int, int, int, int, int]],
    stacks: Sequence[tuple[NDArray[np.uint16], bool]],
) -> tuple[int, str] | None:
    """Decode planes of codecs 0, 4 and 5 in turn, as `gsvrcodec.planes.decode_planes`.

    Returns:
        The number of the first plane that is damaged, and what is wrong; None = none is.
    """

def unpack_numbers(data: bytes, bits: NDArray[np.int8], out: NDArray[np.uint8]) -> None:
    """Read numbers of so many bits each, 0 to 8, the highest bit first, to `out`; shapes (N,)."""
