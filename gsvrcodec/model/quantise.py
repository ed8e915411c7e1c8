"""Uniform scalar quantisation, and how many bits each attribute gets."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.model.gop import Float32Array

#: Bits of each attribute by profile. "paper" is the publication's choice.
BITS: Mapping[str, Mapping[str, int]] = {
    "main": {
        "position": 13,
        "log_scale": 8,
        "rotation": 7,
        "colour": 9,
        "alpha": 7,
        "linear": 11,
        "quadratic": 10,
        "xy": 9,
        "xt": 8,
        "yt": 8,
    },
    "paper": {
        "position": 16,
        "log_scale": 8,
        "rotation": 8,
        "colour": 16,
        "alpha": 8,
        "linear": 8,
        "quadratic": 8,
        "xy": 16,
        "xt": 16,
        "yt": 16,
    },
}


@dataclass(frozen=True, slots=True)
class Quantiser:
    """value = offset + step * code, for codes of `bits` bits (spec section "Dequantisation")."""

    bits: int  #: 1 to 16
    offset: float  #: value of code 0; a float32
    step: float  #: distance of neighbouring values; a float32, 0 = all codes give the offset

    @classmethod
    def fit(cls, values: NDArray[np.floating], bits: int) -> Self:
        """The quantiser whose codes span the values from the smallest to the largest.

        Args:
            values: Any shape, at least one value, all finite.
            bits: 1 to 16.

        Raises:
            ValueError: A value is not finite.
        """
        low, high = float(values.min()), float(values.max())
        if not (np.isfinite(low) and np.isfinite(high)):
            raise ValueError("a value to quantise is not finite")
        offset = np.float32(low)
        step = np.float32((high - float(offset)) / ((1 << bits) - 1))
        return cls(bits, float(offset), float(max(step, np.float32(0))))

    @property
    def last(self) -> float:
        """Value of the largest code."""
        return self.offset + self.step * ((1 << self.bits) - 1)

    def quantise(self, values: NDArray[np.floating]) -> NDArray[np.uint16]:
        """Nearest codes, halves to even, clipped to the range."""
        if not self.step:
            return np.zeros(values.shape, np.uint16)
        codes = np.rint((values.astype(np.float64) - self.offset) / self.step)
        return np.clip(codes, 0, (1 << self.bits) - 1).astype(np.uint16)

    def dequantise(self, codes: NDArray[np.uint16]) -> Float32Array:
        """The values of codes: exact in binary64 but for one rounding, then one to binary32."""
        return (codes * np.float64(self.step) + self.offset).astype(np.float32)
