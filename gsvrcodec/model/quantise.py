"""Uniform scalar quantisation: with a number of bits over the range, or with a given step."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.model.attributes import ATTRIBUTES, CARRIED_ATTRIBUTES, MODE, Attribute
from gsvrcodec.model.gop import Float32Array, Gop
from gsvrcodec.model.refinement import REFINED, Bits, Numbers, Refinement, Refinements, levels
from gsvrcodec.model.static import append_gaussians, select_gaussians
from gsvrcodec.native import _core

_MAX_BITS = 16

#: Bits of each attribute in the publication.
PAPER_BITS: Mapping[str, int] = {
    "position": 16,
    "log_scale": 8,
    "rotation": 8,
    "colour": 16,
    "indicator": 8,
    "linear": 8,
    "quadratic": 8,
    "xy": 16,
    "xt": 16,
    "yt": 16,
}
#: Quantiser step of each component, by attribute name.
Steps = Mapping[str, tuple[float, ...]]


@dataclass(frozen=True, slots=True)
class Refined:
    """Steps of base values, and how many bits more each Gaussian has."""

    steps: tuple[float, ...]  #: of each component
    refinement: Refinement


#: By attribute name: bits over the range of the values, quantiser steps, or refined steps.
Precision = Mapping[str, int | tuple[float, ...] | Refined]


#: Binary digits of a step, which a file has in 16 bits (spec section "Plane table").
STEP_DIGITS = 9
#: Exponent of the last digit of a step of 1, and of the least step.
_STEP_BIAS = 136
#: Multiples of a step that values may be: a file has them as zigzag varints of at most 32 bits.
MOST_MULTIPLE = 2**30
#: Magnitude up to which a value counts as 0 where all values are equal.
LEAST_VALUE = 2.0**-96


def short_step(
    step: float, digits: int = STEP_DIGITS, whole: Callable[[float], int] = round
) -> float:
    """Return the nearest step of so many binary digits, which may be at most those of a file.

    Args:
        step: Above 0.
        digits: Of the step.
        whole: `math.ceil` for the next longer step, `math.floor` for the next shorter one.
    """
    fraction, exponent = math.frexp(step)
    return math.ldexp(whole(math.ldexp(fraction, digits)), exponent - digits)


def step_number(step: float) -> int:
    """Return the 16 bits that stand for a step.

    Raises:
        ValueError: The step has more than nine binary digits, or is far too small or large.
    """
    fraction, exponent = math.frexp(step)
    mantissa, octave = math.ldexp(fraction, STEP_DIGITS), exponent - STEP_DIGITS + _STEP_BIAS
    if not (mantissa.is_integer() and mantissa > 0 and 0 <= octave < 256):
        raise ValueError(f"no step of a quantiser: {step}")
    return int(mantissa) - 256 + 256 * octave


def step_of(number: int) -> float:
    """Return the step that 16 bits stand for."""
    return math.ldexp(256 + number % 256, number // 256 - _STEP_BIAS)


class Quantiser(NamedTuple):
    """value = (first + code) * step, for codes of `bits` bits (spec section "Dequantisation")."""

    bits: int  #: 1 to 16
    first: int  #: value of code 0, steps
    step: float  #: difference of neighbouring values, above 0; at most nine binary digits

    @classmethod
    def choose(
        cls, values: NDArray[np.floating], attribute: Attribute, part: int, precision: Precision
    ) -> Self:
        """The quantiser of one component of an attribute, by the steps or bits of `precision`.

        Raises:
            ValueError: A value is not finite or, where bits are wanted, out of the spec's bounds.
        """
        if attribute is MODE:
            return cls(*MODE_QUANTISER)
        own = attribute.name in precision
        wanted = precision[attribute.name if own else attribute.change_of]
        bounds = attribute.low, attribute.high
        if isinstance(wanted, int):
            low, high = float(values.min()), float(values.max())
            if low < bounds[0] or high > bounds[1]:
                raise ValueError(
                    f"{attribute.name} spans {low:g} to {high:g}, "
                    f"allowed is {bounds[0]:g} to {bounds[1]:g}"
                )
            return cls.fit(values, wanted, bounds)
        if isinstance(wanted, Refined):
            wanted = wanted.steps
        return cls.of_step(values, wanted[part], bounds)

    @classmethod
    def fit(cls, values: NDArray[np.floating], bits: int, bounds: tuple[float, float]) -> Self:
        """The quantiser whose codes span the values from the smallest to the largest.

        Where all values are equal, one bit is enough for them, or for 0 below 2^-96. Else one code
        in 2**bits is to spare, so that code 0 may be a multiple of the step. Values are clipped
        with a bit a value, to two multiples, and where they reach over nearly all of the bounds.

        Args:
            values: Any shape, at least one value, all finite.
            bits: 1 to 16.
            bounds: Least and largest value that a code may stand for.

        Raises:
            ValueError: A value is not finite.
        """
        low, high = (float(np.float32(value)) for value in (values.min(), values.max()))
        if not (np.isfinite(low) and np.isfinite(high)):
            raise ValueError("a value to quantise is not finite")
        if low == high:
            steps, parts = low.as_integer_ratio() if abs(low) > LEAST_VALUE else (0, 1)
            return cls(1, steps - (steps > 0), 1 / parts)  # both codes are nearer to 0
        span, most = (high - low) / max((1 << bits) - 2, 1), (1 << bits) - 1
        wanted = short_step(max(span, max(-low, high) / MOST_MULTIPLE), whole=math.ceil)
        step = min(wanted, short_step((bounds[1] - bounds[0]) / (most + 1), whole=math.floor))
        first = min(math.floor(low / step), math.floor(bounds[1] / step) - most)
        return cls(bits, max(first, math.ceil(bounds[0] / step)), step)

    @classmethod
    def of_step(
        cls, values: NDArray[np.floating], step: float, bounds: tuple[float, float]
    ) -> Self:
        """The quantiser to whole multiples of a step, with as many bits as the values need.

        Where the bounds leave fewer multiples than the values need, the step is longer. Where 16
        bits are too few, values are clipped to the multiples around the median.

        Args:
            values: Any shape, at least one value, all finite.
            step: Above 0; rounded to the nearest that a file can hold.
            bounds: Least and largest value that a code may stand for.

        Raises:
            ValueError: A value is not finite.
        """
        if not np.isfinite(values).all():
            raise ValueError("a value to quantise is not finite")
        size = short_step(step)
        least, most = _multiples(bounds, size)
        room = (most - least + 1).bit_length() - 1
        if room < _MAX_BITS and (float(values.max()) - float(values.min())) / size >= 1 << room:
            size = short_step((bounds[1] - bounds[0]) / (1 << room), whole=math.floor)
            least, most = _multiples(bounds, size)
        codes = np.clip(np.rint(np.asarray(values, np.float64) / size), least, most)
        low, high = int(codes.min()), int(codes.max())
        bits = min(max(1, (high - low).bit_length()), room, _MAX_BITS)
        if high - low >> bits:
            low = round(float(np.median(codes))) - (1 << (bits - 1))
        low = max(least, min(low, most + 1 - (1 << bits)))
        return cls(bits, low, size)

    @property
    def offset(self) -> float:
        """Value of code 0; exact."""
        return self.first * self.step

    @property
    def last(self) -> float:
        """Value of the largest code, 2**bits - 1; exact."""
        return (self.first + (1 << self.bits) - 1) * self.step

    def quantise(self, values: NDArray[np.floating]) -> NDArray[np.uint16]:
        """Nearest codes, rounded half to even and clipped to 0 .. 2**bits - 1."""
        codes = np.rint((values.astype(np.float64) - self.offset) / self.step)
        return np.clip(codes, 0, (1 << self.bits) - 1).astype(np.uint16)

    def refine(
        self, values: NDArray[np.floating], codes: NDArray[np.uint16], bits: Bits
    ) -> Numbers:
        """Where in the cells of their codes values lie: numbers below 2**bits.

        Args:
            values: Any shape.
            codes: Of the values, from `quantise`.
            bits: How many bits refine each value.
        """
        inside = (values.astype(np.float64) - self.offset) / self.step - codes + 0.5
        parts = np.floor(np.ldexp(inside, bits))
        return np.clip(parts, 0, np.ldexp(1.0, bits) - 1).astype(np.uint8)


def _multiples(bounds: tuple[float, float], step: float) -> tuple[int, int]:
    """Return the least and the greatest multiple of a step that codes may stand for."""
    least = max(math.ceil(bounds[0] / step), -MOST_MULTIPLE)
    return least, min(math.floor(bounds[1] / step), MOST_MULTIPLE) - 1


#: Quantiser of `mode`; the greatest mode is 4.
MODE_QUANTISER = Quantiser(3, 0, 1.0)


def component(
    values: NDArray[np.floating], attribute: Attribute, part: int, *, changes: bool = False
) -> NDArray[np.floating]:
    """Values of one component of an attribute; rotations, not changes, are wrapped to [0, pi)."""
    if attribute.components > 1:
        values = values[..., part]
    # A Gaussian has period pi in its rotation; values of one period need the fewest bits.
    wrapped = attribute.name == "rotation" and not changes
    return np.mod(values, np.pi) if wrapped else values


@dataclass(frozen=True, slots=True, eq=False)
class Finer:
    """What refines the codes of an attribute of N Gaussians (spec section "Refinement")."""

    bits: Bits  #: (N,) how many bits refine each value
    numbers: Numbers  #: (components, N) what they say: below 2**bits


def values_of(
    codes: NDArray[np.uint16],
    quantisers: Sequence[Quantiser],
    attribute: Attribute,
    finer: Finer | None = None,
) -> Float32Array:
    """Values of the codes of an attribute, clipped to its bounds.

    Computed in binary64 with one rounding, then rounded to binary32.

    Args:
        codes: (components, ...); each component is C-contiguous.
        quantisers: Of each component.
        attribute: The attribute.
        finer: What refines the codes, which are (components, N); None = nothing.

    Returns:
        (..., components), or (...) if there is one.
    """
    components, *shape = codes.shape
    values = np.empty((codes[0].size, components), np.float32)
    _core.dequantise(
        codes.reshape(components, -1),
        [quantiser.offset for quantiser in quantisers],
        [quantiser.step for quantiser in quantisers],
        finer.bits if finer else None,
        finer.numbers if finer else None,
        attribute.low,
        attribute.high,
        values,
    )
    return values.reshape(shape if components == 1 else (*shape, components))


@dataclass(frozen=True, slots=True, eq=False)
class Coded:
    """One component of an attribute, as a writer quantises it."""

    attribute: Attribute
    samples: NDArray[np.floating]  #: what is stored; any shape
    quantiser: Quantiser
    codes: NDArray[np.uint16]  #: of the samples

    def parts(self, bits: Bits) -> Numbers:
        """Numbers of so many bits that refine the codes."""
        return self.quantiser.refine(self.samples, self.codes, bits)


def quantised(
    values: Mapping[str, NDArray[np.floating]],
    attributes: Iterable[Attribute],
    precision: Precision,
    *,
    changes: bool = False,
) -> dict[str, tuple[Coded, ...]]:
    """Quantise the components of attributes, without those that have no samples.

    Args:
        values: By attribute name, of values or, with `changes`, of what is added to a reference.
        attributes: To quantise.
        precision: Bits or quantiser steps.
        changes: Whether the values are changes, of which rotations have no period.

    Raises:
        ValueError: A value is not finite or out of the spec's bounds.
    """
    found: dict[str, tuple[Coded, ...]] = {}
    for attribute in attributes:
        if not values[attribute.name].size:
            continue
        parts = []
        for part in range(attribute.components):
            samples = component(values[attribute.name], attribute, part, changes=changes)
            quantiser = Quantiser.choose(samples, attribute, part, precision)
            parts.append(Coded(attribute, samples, quantiser, quantiser.quantise(samples)))
        found[attribute.name] = tuple(parts)
    return found


def values_of_coded(parts: Sequence[Coded], bits: Bits | None = None) -> Float32Array:
    """Values that a decoder gets for an attribute, of whose codes so many bits refine each."""
    codes = np.stack([part.codes for part in parts])
    finer = None
    if bits is not None:
        finer = Finer(bits, np.stack([part.parts(bits) for part in parts]))
    return values_of(codes, [part.quantiser for part in parts], parts[0].attribute, finer)


def refinements_of(precision: Precision) -> dict[str, Refinement]:
    """Refinement of each attribute that is refined, in the order of `REFINED`."""
    wanted = {name: precision[name] for name in REFINED}
    return {name: own.refinement for name, own in wanted.items() if isinstance(own, Refined)}


#: Attributes whose base values say how many bits refine a Gaussian.
SET_BITS = frozenset({"log_scale", "log_opacity", "indicator", "linear", "quadratic"})


def bits_of(values: Mapping[str, Float32Array], refinements: Refinements) -> dict[str, Bits]:
    """How many bits refine each Gaussian, (N,), for each attribute that is refined.

    Args:
        values: Base values by attribute name; those of `SET_BITS` count.
        refinements: Of the attributes that are refined.
    """
    if not refinements:
        return {}
    log_scale = values["log_scale"]
    # Sums have no opacities.
    log_opacity = values.get("log_opacity", np.zeros(len(log_scale), np.float32))
    found = levels(log_scale, log_opacity)
    bits = {name: own.bits(found[name]) for name, own in refinements.items()}
    if motion := bits.keys() & {"linear", "quadratic"}:
        moves = values["indicator"] != 1
        for way in (*values["linear"].T, *values["quadratic"].T):
            moves |= way != 0
        for name in motion:
            bits[name] *= moves
    return bits


def of_carried(precision: Precision) -> Precision:
    """What is stored of carried Gaussians, by the names of `Gop`."""
    own = {a.change_of: precision[a.name] for a in CARRIED_ATTRIBUTES if a.name in precision}
    return {**precision, **own}


def dequantised(gop: Gop, precision: Precision, carried: NDArray[np.bool_] | None = None) -> Gop:
    """The GOP that a decoder gets for `gop`, quantised and dequantised, in the given order.

    Attributes that `precision` lacks stay as they are, as opacities where pictures are sums.

    Args:
        gop: Stored values.
        precision: Bits or quantiser steps.
        carried: (N,) Gaussians of a reference, of which changes are stored; None = there are none.

    Raises:
        ValueError: A value is not finite or out of the spec's bounds.
    """
    if carried is None:
        return _dequantised(gop, precision)
    new = _dequantised(select_gaussians(gop, ~carried), precision)
    changes = _dequantised(select_gaussians(gop, carried), of_carried(precision), changes=True)
    order = np.argsort(np.argsort(carried, kind="stable"), kind="stable")
    return select_gaussians(append_gaussians(new, changes), order)


def _dequantised(gop: Gop, precision: Precision, *, changes: bool = False) -> Gop:
    original = {a.name: getattr(gop, a.name) for a in ATTRIBUTES}
    wanted = [a for a in ATTRIBUTES if a.name in precision]
    coded = quantised(original, wanted, precision, changes=changes)
    values = {name: values_of_coded(parts) for name, parts in coded.items()}
    bits = bits_of(values, refinements_of(precision)) if len(gop) else {}
    values |= {name: values_of_coded(coded[name], own) for name, own in bits.items()}
    return Gop(**original | values)
