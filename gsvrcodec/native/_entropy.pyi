from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

class Corrupt(ValueError): ...

class Predictor:
    def __init__(
        self,
        terms: Sequence[tuple[int, int]],
        bias: int,
        guided: bool,
        weights: Sequence[int],
    ) -> None: ...

class Coding:
    def __init__(self, direct: int, top: int, thresholds: Sequence[int]) -> None: ...

def follow(guide: NDArray[np.uint16], columns: NDArray[np.uint16]) -> None: ...
def predict(
    samples: NDArray[np.uint16],
    bits: int,
    prior: NDArray[np.uint16],
    columns: NDArray[np.uint16] | None,
    predictor: Predictor,
    errors: NDArray[np.int32],
    around: NDArray[np.uint32],
) -> None: ...
def measure(errors: NDArray[np.int32], around: NDArray[np.uint32], coding: Coding) -> float: ...
def encode_context(
    samples: NDArray[np.uint16],
    bits: int,
    prior: NDArray[np.uint16],
    columns: NDArray[np.uint16] | None,
    predictor: Predictor,
    coding: Coding,
) -> bytes: ...
def decode_context(
    data: bytes,
    bits: int,
    prior: NDArray[np.uint16],
    columns: NDArray[np.uint16] | None,
    out: NDArray[np.uint16],
) -> None: ...
def encode_ranges(samples: NDArray[np.uint16]) -> bytes: ...
def decode_ranges(data: bytes, bits: int, out: NDArray[np.uint16]) -> None: ...
