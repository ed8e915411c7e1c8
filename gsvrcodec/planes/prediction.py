"""Candidate predictors of codec 4: weights fitted to a plane by the encoder.

None of this is normative: a decoder reads the weights from the plane.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.planes.prior import PriorPlanes
from gsvrcodec.planes.samples import Samples

Floats = NDArray[np.float64]
NEIGHBOURS = 6
#: Units of the coded weights: 1/256 for prior planes and bias, 1/64 for neighbours.
_PLANE_UNIT = 256
_NEAR_UNIT = 64
_MAX_WEIGHT_SUM = 1 << 12
_MAX_BIAS = (1 << 29) - 1
_MAX_TERMS = 15
#: Most samples of a fit, and iterations of its reweighting.
_FIT_SAMPLES = 2048
_FIT_ROUNDS = 3


class Predictor(NamedTuple):
    """The fields of `_entropy.Predictor`, in its order."""

    terms: tuple[tuple[int, int], ...]  #: numbers and weights of prior planes
    bias: int
    guided: bool  #: the neighbour above is the one that the first plane chooses
    weights: tuple[int, ...]  #: of the neighbours


def predictors(samples: Samples, bits: int, prior: PriorPlanes) -> Iterator[Predictor]:
    """Yield candidate predictors of a plane, shape (height, width): constants, left, fits."""
    values = samples.astype(np.float64)
    near = _neighbours(prior.columns, samples.shape)
    guided = prior.columns is not None
    count = len(prior.planes)
    chosen = np.linspace(0, samples.size - 1, min(samples.size, _FIT_SAMPLES)).astype(np.intp)
    nothing = (0,) * NEIGHBOURS
    for constant in (1 << (bits - 1), float(np.median(values))):
        yield Predictor((), _fixed(constant, _PLANE_UNIT), False, nothing)
    yield Predictor((), 0, False, (_NEAR_UNIT, *nothing[1:]))
    for first in _term_choices(count):
        planes = prior.planes[first:].reshape(count - first, samples.size)
        columns = np.vstack([planes, np.ones(samples.size)])
        fitted = _robust_fit(columns[:, chosen], values.flat[chosen])
        whole = [_fixed(weight, _PLANE_UNIT) for weight in fitted]
        terms = tuple((first + i, w) for i, w in enumerate(whole[:-1]) if w)
        if sum(abs(w) for _, w in terms) > _MAX_WEIGHT_SUM or abs(whole[-1]) > _MAX_BIAS:
            continue
        rest = values.ravel() - np.array(whole) @ columns / _PLANE_UNIT
        fitted = _robust_fit(rest[near[:, chosen]], rest[chosen])
        weights = tuple(max(-128, min(127, _fixed(w, _NEAR_UNIT))) for w in fitted)
        if terms:
            yield Predictor(terms, whole[-1], False, nothing)
        yield Predictor(terms, whole[-1], guided, weights)


def adapted(predictor: Predictor, samples: Samples, prior: PriorPlanes) -> Predictor:
    """A predictor of a plane like this one, with the bias that suits this plane."""
    chosen = np.linspace(0, samples.size - 1, min(samples.size, _FIT_SAMPLES)).astype(np.intp)
    rest = samples.flat[chosen].astype(np.float64)
    planes = prior.planes.reshape(len(prior.planes), samples.size)
    for plane, weight in predictor.terms:
        rest -= planes[plane, chosen] * (weight / _PLANE_UNIT)
    bias = _fixed(float(np.median(rest)), _PLANE_UNIT)
    bias = max(-_MAX_BIAS, min(_MAX_BIAS, bias))
    return predictor._replace(bias=bias)


def _term_choices(count: int) -> list[int]:
    """Index of the first prior plane of each trial: none, the last, the last two, all planes."""
    return sorted({count, count - 1, count - 2, max(0, count - _MAX_TERMS)} & set(range(count + 1)))


def _robust_fit(columns: Floats, target: Floats) -> Floats:
    """Least absolute deviations by iterated reweighting: weights, shape (k,), of columns (k, n)."""
    trust = np.ones(len(target))
    ridge = 1e-3 * np.eye(len(columns)) * len(target)
    weights = np.zeros(len(columns))
    for _ in range(_FIT_ROUNDS):
        weighted = columns * trust
        weights[:] = np.linalg.solve(weighted @ columns.T + ridge, weighted @ target)
        error = np.abs(target - weights @ columns)
        trust = 1 / (error + max(1.0, float(np.median(error)) / 2))
    return weights


def _neighbours(columns: Samples | None, shape: tuple[int, ...]) -> NDArray[np.intp]:
    """Indices of the six neighbours of each sample, shape (6, height * width)."""
    height, width = shape
    index = np.arange(height * width).reshape(height, width)
    left = index - 1
    left[:, 0] = index[:, 0] - width
    left2 = index - 2
    left2[:, :2] = left[:, :2]
    column = np.arange(width) if columns is None else columns.astype(np.intp)
    above = [
        index[:, :1] - width + np.broadcast_to(np.clip(column + step, 0, width - 1), shape)
        for step in (0, 1, -1, 2)
    ]
    for part in above:
        part[0] = left[0]
    return np.maximum(np.stack([left, left2, *above]).reshape(NEIGHBOURS, -1), 0)


def _fixed(value: float, unit: int) -> int:
    return round(value * unit)
