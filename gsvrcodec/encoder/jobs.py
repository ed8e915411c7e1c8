"""Encoding of one GOP: frames in, chunk payload out; a pure function of its job."""

from __future__ import annotations

import math
import time
from collections import defaultdict
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.bitstream.attribute_planes import Memories
from gsvrcodec.bitstream.gop_payload import pack_gop
from gsvrcodec.encoder.budget import (
    Budget,
    fittable,
    halved,
    key_gaussians,
    most_gaussians,
    triplane_grid,
)
from gsvrcodec.encoder.carried import carried_of, new_of
from gsvrcodec.encoder.rate import frame_visits, visited_frames
from gsvrcodec.encoder.settings import EncodeSettings
from gsvrcodec.fit import predicted
from gsvrcodec.fit.fitting import Allowance, Fit, fit_gop
from gsvrcodec.fit.footage import Footage
from gsvrcodec.fit.options import FitOptions
from gsvrcodec.fit.predicted import fit_predicted
from gsvrcodec.fit.quantised import as_published, quantisable
from gsvrcodec.fit.rate_control import (
    fit_to_psnr,
    quantise_near_size,
    quantise_to_psnr,
    quantise_to_size,
)
from gsvrcodec.fit.tuned import EFFORT, RATE_CONTROL
from gsvrcodec.model.gop import Gop, GridSize
from gsvrcodec.model.prediction import last_look
from gsvrcodec.model.quantise import Precision
from gsvrcodec.model.time import Ticks, normalised_time
from gsvrcodec.planes import PACKS, Memory
from gsvrcodec.render import backend_on
from gsvrcodec.render.device import choose_device


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """The GOP that another is predicted from, as a decoder has it."""

    gop: Gop
    first_frame: int  #: number of its first frame in the file
    frames: int
    qscale: float  #: that it was stored at
    psnr: float  #: dB, mean of its frames


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class GopJob:
    """All that `encode_gop` needs."""

    frames: NDArray[np.uint8]  #: (F, H, W, 3) RGB
    pts: Ticks  #: (F,) ticks
    durations: Ticks  #: (F,) ticks
    first_frame: int  #: number of the first frame in the file
    budget: Budget
    settings: EncodeSettings
    effort: float = 1.0  #: optimiser steps, in those of the preset
    seconds: float | None = None  #: wall time to spend; None = by the preset
    reference: Reference | None = None  #: None = a key GOP

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, pixels."""
        return self.frames.shape[2], self.frames.shape[1]

    @property
    def steps(self) -> int:
        """Optimiser steps, without `seconds`."""
        frames = visited_frames(len(self.frames))
        return round(self.effort * frame_visits(self.settings) * frames)

    @property
    def grid(self) -> GridSize:
        """Gx, Gy, Gt of the tri-plane; zeros for none."""
        if self.budget.grid is not None:
            return self.budget.grid
        usual = triplane_grid(self.size, len(self.frames), self.settings)
        return usual if self.reference is None else halved(usual)

    @property
    def seed(self) -> tuple[int, ...]:
        """Seed of every random choice."""
        return self.settings.seed, self.first_frame

    @property
    def options(self) -> FitOptions:
        """How to fit."""
        return self.settings.fit_options


@dataclass(frozen=True, slots=True, eq=False)
class EncodedGop:
    """A finished GOP."""

    payload: bytes  #: of its chunk
    psnr: float  #: dB, mean of the frames that a decoder will show
    float_psnr: float  #: dB, the same before quantisation
    qscale: float | None  #: of the quantiser steps; None = bits over the range


def encode_gop(job: GopJob) -> EncodedGop:
    """Fit, quantise and pack one GOP.

    The same job gives the same bytes in any process and any order, unless it is timed.
    """
    began = time.perf_counter()
    settings, budget, options, reference = job.settings, job.budget, job.options, job.reference
    backend = backend_on(choose_device(settings.device), settings.threads, settings.blending)
    footage = Footage(job.frames, normalised_time(job.pts))

    def allowance(gaussians: int, share: float = 1.0) -> Allowance:
        """Return a share of the job's effort, without the time that packing takes."""
        seconds, most = None, math.inf
        if job.seconds is not None:
            most = fittable(job.seconds, settings)
            packing = EFFORT.packing_seconds * gaussians
            packing = min(packing, EFFORT.packing_share * job.seconds)
            seconds = share * (job.seconds - packing) - (time.perf_counter() - began)
        return Allowance(share * job.steps, seconds, most)

    def fit(gaussians: int, share: float = 1.0) -> Fit:
        """Fit so many Gaussians of a key GOP with a share of the job's effort."""
        effort = allowance(gaussians, share)
        return fit_gop(
            footage,
            gaussians,
            job.grid,
            options,
            effort,
            backend,
            seed=job.seed,
            slope=budget.slope,
        )

    def fit_from(reference: Reference) -> Fit | None:
        """Predict from the reference; None if that does not pay."""
        last = np.array([1.0 if reference.frames > 1 else 0.0], np.float32)
        shown = backend.render(backend.prepare(reference.gop), last, job.size, job.size)[0]
        look = last_look(reference.gop, reference.frames)
        qscale = reference.qscale if budget.slope is None else budget.slope.stored_qscale
        start = predicted.Reference(look, shown, qscale, reference.psnr)
        return fit_predicted(
            footage,
            start,
            budget.gaussians,
            job.grid,
            options,
            allowance(budget.gaussians),
            backend,
            seed=job.seed,
        )

    def pack(
        fitted: Fit,
        gop: Gop,
        precision: Precision,
        codecs: str,
        memories: Memories | None = None,
    ) -> bytes:
        """Return the payload of the GOP chunk."""
        return pack_gop(
            new_of(fitted, gop),
            job.pts,
            job.durations,
            job.first_frame,
            precision,
            PACKS[codecs],
            reference=job.first_frame - reference.first_frame if reference and fitted.anchor else 0,
            carried=carried_of(fitted, gop, precision),
            memories=memories,
            blending=settings.blending,
        )

    memories: Memories = defaultdict(Memory)
    # The best choice of codecs is 0.1 to 0.4 % smaller, but takes a tenth of a short wall time.
    final = None if job.seconds is None else memories

    def size(gop: Gop, precision: Precision, exact: bool) -> int:
        """Return the bytes of the payload; not `exact` = by a quick choice of codecs."""
        quick = settings.pack == "auto" and not exact
        codecs = "entropy" if quick else settings.pack
        return len(pack(fitted, gop, precision, codecs, final if exact else memories))

    attempt = None if reference is None else fit_from(reference)
    if attempt is not None:
        fitted = attempt
    elif budget.target_psnr is None:
        gaussians = budget.gaussians
        if reference is not None and budget.target_bytes is not None:
            gaussians = min(gaussians, key_gaussians(budget.target_bytes, job.grid))
        fitted = fit(max(1, gaussians))
    else:
        refits = RATE_CONTROL.refits if job.seconds is None else 0
        most = most_gaussians(job.size)
        fitted = fit_to_psnr(fit, budget.target_psnr, budget.gaussians, most, refits=refits)
    if options.profile == "paper":
        stored = as_published(fitted, backend)
    else:
        candidate = quantisable(fitted, options, backend, size, seed=job.seed, slope=budget.slope)
        predicted_from = reference if fitted.anchor is not None else None
        if budget.target_bytes is not None and budget.exact:
            stored = quantise_to_size(candidate, budget.target_bytes)
        elif budget.target_bytes is not None:
            if predicted_from is None:
                qscale = RATE_CONTROL.coarser_key * candidate.usual_qscale
                reach = RATE_CONTROL.key_reach
            else:
                qscale, reach = predicted_from.qscale, RATE_CONTROL.reach
            stored = quantise_near_size(candidate, budget.target_bytes, qscale, reach)
        elif budget.slope is not None:
            stored = candidate.quantised(budget.slope.stored_qscale)
        elif budget.target_psnr is not None:
            stored = quantise_to_psnr(candidate, budget.target_psnr)
        elif predicted_from is not None:
            stored = candidate.quantised(predicted_from.qscale)
        else:
            stored = candidate.quantised(candidate.usual_qscale)
    payload = pack(fitted, stored.gop, stored.precision, settings.pack, final)
    return EncodedGop(payload, stored.psnr, fitted.psnr, stored.qscale)
