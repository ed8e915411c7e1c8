"""Codec 4, context: linear prediction and context modelling (spec section "Codec 4").

The native module predicts and codes; this module chooses predictor, contexts and token division.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.native import _entropy
from gsvrcodec.planes.prediction import Predictor, adapted, predictors
from gsvrcodec.planes.prior import PriorPlanes
from gsvrcodec.planes.samples import PlaneShape, Samples

#: Divisions of errors into tokens, as `direct` and `top` of the spec: numbers below 2^direct have a
#: token each; tokens of larger numbers hold `top` bits after the highest. Few tokens suit small
#: planes.
_DIVISIONS = ((4, 2), (7, 2), (3, 1), (2, 0))
#: Numbers of contexts to try; the thresholds are quantiles, so contexts have equal sample counts.
_CONTEXTS = (1, 2, 3, 4, 6, 8)
#: Token division and number of contexts with which predictors are compared.
_TRIAL = (3, 1), 3
#: Most samples that the quantiles are estimated from.
_QUANTILE_SAMPLES = 4096


@dataclass(slots=True)
class Memory:
    """How the last plane was coded with this memory; None = none yet."""

    choice: tuple[Predictor, tuple[int, int], int] | None = None  #: and division, and contexts


def encode(
    samples: Samples, shape: PlaneShape, prior: PriorPlanes, memory: Memory | None = None
) -> bytes:
    """Code a plane; predictor, number of contexts and token division are chosen in turn.

    With a memory of a similar plane its choices are taken, which is ten times as quick.
    """
    errors = np.empty(samples.shape, np.int32)
    around = np.empty(samples.shape, np.uint32)

    def predict(predictor: Predictor) -> NDArray[np.uint32]:
        """Fill `errors` and `around`; return a sorted subset of `around`."""
        _entropy.predict(
            samples,
            shape.bits,
            prior.planes,
            prior.columns,
            _entropy.Predictor(*predictor),
            errors,
            around,
        )
        return np.sort(around.ravel()[:: -(-around.size // _QUANTILE_SAMPLES)])

    def cost(coding: _entropy.Coding) -> float:
        return _entropy.measure(errors, around, coding)

    if memory is not None and memory.choice is not None:
        predictor, division, contexts = memory.choice
        predictor = adapted(predictor, samples, prior)
        coding = _coding(division, contexts, predict(predictor))
    else:
        predictor = min(
            predictors(samples, shape.bits, prior),
            key=lambda predictor: cost(_coding(*_TRIAL, predict(predictor))),
        )
        ordered = predict(predictor)
        contexts = min(_CONTEXTS, key=lambda count: cost(_coding(_DIVISIONS[0], count, ordered)))
        division = min(_DIVISIONS, key=lambda part: cost(_coding(part, contexts, ordered)))
        coding = _coding(division, contexts, ordered)
    if memory is not None:
        memory.choice = predictor, division, contexts
    return _entropy.encode_context(
        samples,
        shape.bits,
        prior.planes,
        prior.columns,
        _entropy.Predictor(*predictor),
        coding,
    )


def _coding(
    division: tuple[int, int], contexts: int, ordered: NDArray[np.uint32]
) -> _entropy.Coding:
    """A coding whose context thresholds are quantiles of `ordered`, the sorted `around` values."""
    bounds = ordered[(np.arange(1, contexts) * ordered.size) // contexts]
    return _entropy.Coding(*division, np.unique(bounds[bounds > 0]).tolist())
