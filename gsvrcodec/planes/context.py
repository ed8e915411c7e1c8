"""Codec 4, context: predicted samples, coded by what their neighbourhood makes likely.

See spec section "Codec 4". The native module does the work; the search for what to tell it is here.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.errors import CorruptError
from gsvrcodec.native import _entropy
from gsvrcodec.planes.prediction import predictors
from gsvrcodec.planes.prior import PriorPlanes
from gsvrcodec.planes.samples import PlaneShape, Samples

#: Divisions of errors into tokens: numbers with a token of their own (as a power of two), and bits
#: after the highest that others have in theirs. Few tokens are for small planes.
_DIVISIONS = ((4, 2), (7, 2), (3, 1), (2, 0))
#: Numbers of contexts; each holds as many samples as the others.
_CONTEXTS = (1, 2, 3, 4, 6, 8)
#: Division and contexts with which predictors are compared.
_TRIAL = (3, 1), 3
#: Quantiles are taken from so many samples at most.
_QUANTILE_SAMPLES = 4096


def encode(samples: Samples, shape: PlaneShape, prior: PriorPlanes) -> bytes:
    """The stream of the best predictor, number of contexts and division, one after the other."""
    errors = np.empty(samples.shape, np.int32)
    around = np.empty(samples.shape, np.uint32)

    def predict(predictor: _entropy.Predictor) -> NDArray[np.uint32]:
        """Fill both arrays; return a sorted sample of the second."""
        _entropy.predict(
            samples, shape.bits, prior.planes, prior.columns, predictor, errors, around
        )
        return np.sort(around.ravel()[:: -(-around.size // _QUANTILE_SAMPLES)])

    def cost(coding: _entropy.Coding) -> float:
        return _entropy.measure(errors, around, coding)

    predictor = min(
        predictors(samples, shape.bits, prior),
        key=lambda predictor: cost(_coding(*_TRIAL, predict(predictor))),
    )
    ordered = predict(predictor)
    contexts = min(_CONTEXTS, key=lambda count: cost(_coding(_DIVISIONS[0], count, ordered)))
    coding = min((_coding(part, contexts, ordered) for part in _DIVISIONS), key=cost)
    return _entropy.encode_context(
        samples, shape.bits, prior.planes, prior.columns, predictor, coding
    )


def decode(data: bytes, shape: PlaneShape, prior: PriorPlanes) -> Samples:
    """The samples of a stream that ends with `data`."""
    out = np.empty((shape.height, shape.width), np.uint16)
    try:
        _entropy.decode_context(data, shape.bits, prior.planes, prior.columns, out)
    except _entropy.Corrupt as error:
        raise CorruptError(f"damaged context plane: {error}") from None
    return out


def _coding(
    division: tuple[int, int], contexts: int, ordered: NDArray[np.uint32]
) -> _entropy.Coding:
    """Contexts bounded by quantiles of `ordered`, the sorted magnitudes around the samples."""
    bounds = ordered[(np.arange(1, contexts) * ordered.size) // contexts]
    return _entropy.Coding(*division, np.unique(bounds[bounds > 0]).tolist())
