"""One fit, quantised at any qscale."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gsvrcodec.fit.fitting import Fit, mean_psnr, single_torch_thread
from gsvrcodec.fit.footage import Footage
from gsvrcodec.fit.options import FitOptions
from gsvrcodec.fit.precision import equal_slope_steps, usual_qscale
from gsvrcodec.fit.recipe import MAIN
from gsvrcodec.fit.sensitivity import sensitivities
from gsvrcodec.fit.staged import quantise_in_stages
from gsvrcodec.fit.static import with_static
from gsvrcodec.model.gop import Gop
from gsvrcodec.model.quantise import PAPER_BITS, Precision, dequantised
from gsvrcodec.render.backend import Backend

#: Bytes of a GOP at a precision: (gop, precision, exact) -> size; not exact = quick.
Measure = Callable[[Gop, Precision, bool], int]


@dataclass(frozen=True, slots=True, eq=False)
class Quantised:
    """What is stored of a GOP."""

    gop: Gop  #: values before the last rounding
    precision: Precision  #: steps or bits
    psnr: float  #: dB, mean of the frames that a decoder will show


@dataclass(frozen=True, slots=True, eq=False)
class QuantisedFit:
    """A fit that can be stored at any qscale; implements `rate_control.Candidate`."""

    fit: Fit
    footage: Footage
    sensitivities: Gop
    options: FitOptions
    backend: Backend
    measure: Measure
    seed: tuple[int, ...]

    @property
    def psnr(self) -> float:
        """PSNR before quantisation, dB."""
        return self.fit.psnr

    @property
    def usual_qscale(self) -> float:
        """The qscale at which quantisation costs 0.2 dB."""
        return usual_qscale(self.footage.pixels, len(self.fit.gop), self.fit.psnr)

    @property
    def is_tuned(self) -> bool:
        """Whether `quantised` tunes."""
        return self.fit.tuning is not None

    def size(self, qscale: float, *, exact: bool = False) -> int:
        """Bytes at a qscale, before tuning; not `exact` = by the quick choice of codecs."""
        return self.measure(*self._stored(qscale), exact)

    def quality(self, qscale: float) -> float:
        """PSNR at a qscale before tuning, dB."""
        return self._psnr(*self._stored(qscale))

    def quantised(self, qscale: float, *, trials: int = 1) -> Quantised:
        """Round and tune; `trials` calls share a wall time."""
        gop, precision = self._stored(qscale)
        if (tuning := self.fit.tuning) is not None:
            with single_torch_thread():
                gop = quantise_in_stages(
                    gop,
                    precision,
                    self.footage,
                    MAIN,
                    round(tuning.steps),
                    None if tuning.seconds is None else tuning.seconds / trials,
                    np.random.default_rng((*self.seed, 1)),
                    self.backend,
                    deform=self.options.deform,
                )
        return Quantised(gop, precision, self._psnr(gop, precision))

    def _stored(self, qscale: float) -> tuple[Gop, Precision]:
        gop = with_static(self.fit.gop, self.sensitivities, qscale)
        return gop, equal_slope_steps(self.sensitivities, qscale)

    def _psnr(self, gop: Gop, precision: Precision) -> float:
        return mean_psnr(dequantised(gop, precision), self.footage, self.backend)


def quantisable(
    fit: Fit,
    footage: Footage,
    options: FitOptions,
    backend: Backend,
    measure: Measure,
    *,
    seed: tuple[int, ...],
) -> QuantisedFit:
    """Measure the sensitivities of a fit, so that it can be stored at any qscale."""
    rng = np.random.default_rng(seed)
    found = sensitivities(footage, fit.gop, rng, backend)
    return QuantisedFit(fit, footage, found, options, backend, measure, seed)


def as_published(fit: Fit, footage: Footage, backend: Backend) -> Quantised:
    """Return a fit with the publication's bits over the range of each attribute."""
    psnr = mean_psnr(dequantised(fit.gop, PAPER_BITS), footage, backend)
    return Quantised(fit.gop, PAPER_BITS, psnr)
