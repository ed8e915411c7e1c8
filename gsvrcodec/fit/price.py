"""The price of bits in a fit: of changes, and of what differs from its neighbours."""

from __future__ import annotations

import math

import numpy as np

from gsvrcodec.fit.parameters import LOOK, MOTION, Parameters, Tensors, put
from gsvrcodec.fit.tuned import PRICE
from gsvrcodec.model.quantise import Steps
from gsvrcodec.render.backend import Backend, Prices

#: Of what is carried over, changes are stored; of new Gaussians, values.
_PRICES = {
    "position": Prices(PRICE.change),
    "log_scale": Prices(PRICE.change, PRICE.log_scale, PRICE.near),
    "rotation": Prices(PRICE.change),
    "colour": Prices(PRICE.change),
    "log_opacity": Prices(PRICE.change, PRICE.log_opacity),
    **dict.fromkeys(MOTION, Prices(0.0, PRICE.motion, PRICE.near)),
}


class Price:
    """Adds the slope of weight * log2(1 + |difference| / step) to the gradients of a fit.

    Without it a fit drifts along directions that hardly change the picture, and bits are spent on
    them. A Gaussian that is carried over pays for its changes. A new one pays for an opacity that
    is not 1, and for scales that differ from those of its neighbours in drawing order. All pay for
    motion that differs from that of their neighbours.

    Args:
        steps: quantiser steps of the attributes.
        weight: loss that one bit may cost.
        backend: of the fit.
    """

    def __init__(self, steps: Steps, weight: float, backend: Backend) -> None:
        self._weight = weight / math.log(2)
        self._steps = {
            name: backend.hold(np.array(steps[name], np.float32)) for name in (*LOOK, *MOTION)
        }
        self._slopes: Tensors = {}

    def add(self, gradients: Tensors) -> None:
        """Add the slopes to gradients, in place."""
        for name, slope in self._slopes.items():
            gradients[name] += slope

    def look(self, parameters: Parameters) -> None:
        """Compute the slopes: before `add`, and again now and then, since they change slowly."""
        put(self._slopes, self._computed(parameters))

    def forget(self) -> None:
        """Forget the slopes: the Gaussians are others, or in another order."""
        self._slopes = {}

    def _computed(self, parameters: Parameters) -> Tensors:
        slopes: Tensors = {}
        carried, stored = parameters.carried, parameters.raw | parameters.changes()
        for name, step in self._steps.items():
            prices = _PRICES[name]
            free = carried is None and not prices.fresh
            if name not in parameters.raw or free:
                continue
            value = stored[name]
            columns = value.reshape(len(value), -1)
            of_reference = None if name in MOTION else carried
            slope = parameters.backend.price_slopes(columns, step, of_reference, prices)
            slope *= self._weight
            slopes[name] = slope.reshape(value.shape)
        parameters.pass_back(slopes)
        return slopes
