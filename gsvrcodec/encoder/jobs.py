"""Encoding of one GOP: frames in, chunk payload out; a pure function of its job."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.bitstream.background_payload import pack_background
from gsvrcodec.bitstream.gop_payload import pack_gop
from gsvrcodec.encoder.background import visible_gaussians
from gsvrcodec.encoder.budget import Budget, most_gaussians, triplane_grid
from gsvrcodec.encoder.settings import EncodeSettings
from gsvrcodec.fit.fitting import Allowance, Fit, fit_gop
from gsvrcodec.fit.footage import Footage
from gsvrcodec.fit.options import FitOptions
from gsvrcodec.fit.quantised import as_published, quantisable
from gsvrcodec.fit.rate_control import fit_to_psnr, quantise_to_psnr, quantise_to_size
from gsvrcodec.fit.tuned import EFFORT, RATE_CONTROL
from gsvrcodec.model.background import Background, select_gaussians
from gsvrcodec.model.gop import Gop, GridSize
from gsvrcodec.model.quantise import Precision
from gsvrcodec.model.time import Ticks, normalised_time
from gsvrcodec.planes import PACKS, Codec
from gsvrcodec.render import backend_on
from gsvrcodec.render.device import choose_device

Visible = NDArray[np.bool_]  #: which Gaussians of a background a GOP shows


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Job(ABC):
    """All that `encode_gop` needs."""

    frames: NDArray[np.uint8]  #: (F, H, W, 3) RGB
    budget: Budget
    settings: EncodeSettings
    seconds: float | None = None  #: wall time to spend; None = by the preset

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, pixels."""
        return self.frames.shape[2], self.frames.shape[1]

    @property
    @abstractmethod
    def steps(self) -> int:
        """Optimiser steps, without `seconds`."""

    @property
    @abstractmethod
    def grid(self) -> GridSize:
        """Gx, Gy, Gt of the tri-plane; zeros for none."""

    @property
    @abstractmethod
    def seed(self) -> tuple[int, ...]:
        """Seed of every random choice."""

    @property
    def options(self) -> FitOptions:
        """How to fit."""
        return self.settings.fit_options

    @abstractmethod
    def footage(self) -> tuple[Footage, Visible | None]:
        """Return the frames to fit, and the Gaussians of the background that are behind them."""

    @abstractmethod
    def payload(
        self, gop: Gop, precision: Precision, codecs: Collection[Codec], visible: Visible | None
    ) -> bytes:
        """Return the payload of the chunk."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class GopJob(Job):
    """One GOP to be fitted."""

    pts: Ticks  #: (F,) ticks
    durations: Ticks  #: (F,) ticks
    first_frame: int  #: number of the first frame in the file
    background: Background | None = None  #: Gaussians that the GOP may show behind its own
    background_picture: NDArray[np.uint8] | None = (
        None  #: (H, W, 3) that `background` was fitted to
    )

    @property
    def steps(self) -> int:
        """Optimiser steps, without `seconds`."""
        return EFFORT.frame_visits[self.settings.preset] * len(self.frames)

    @property
    def grid(self) -> GridSize:
        """Gx, Gy, Gt of the tri-plane; zeros for none."""
        return self.budget.grid or triplane_grid(self.size, len(self.frames), self.settings)

    @property
    def seed(self) -> tuple[int, ...]:
        """Seed of every random choice."""
        return self.settings.seed, self.first_frame

    def footage(self) -> tuple[Footage, Visible | None]:
        """Return the frames to fit, and the Gaussians of the background that are behind them."""
        taus = normalised_time(self.pts)
        if self.background is not None and self.background_picture is not None:
            visible = visible_gaussians(self.background, self.background_picture, self.frames)
            if visible.any():
                behind = select_gaussians(self.background.gop, visible)
                return Footage(self.frames, taus, behind), visible
        return Footage(self.frames, taus), None

    def payload(
        self, gop: Gop, precision: Precision, codecs: Collection[Codec], visible: Visible | None
    ) -> bytes:
        """Return the payload of the GOP chunk."""
        number = 0 if visible is None or self.background is None else self.background.number
        return pack_gop(
            gop,
            self.pts,
            self.durations,
            self.first_frame,
            precision,
            codecs,
            background=number,
            shown=visible,
        )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class BackgroundJob(Job):
    """A background to be fitted to one picture, `frames` (1, H, W, 3)."""

    number: int  #: by which GOPs name it, from 1
    shown: int  #: frames of the GOPs that may show it

    @property
    def steps(self) -> int:
        """Optimiser steps, without `seconds`."""
        visits = EFFORT.background_visits * EFFORT.frame_visits[self.settings.preset]
        return max(EFFORT.least_background_steps, visits)

    @property
    def grid(self) -> GridSize:
        """Gx, Gy, Gt of the tri-plane: none."""
        return 0, 0, 0

    @property
    def options(self) -> FitOptions:
        """How to fit: nothing moves by a tri-plane."""
        return replace(self.settings.fit_options, deform="polynomial")

    @property
    def seed(self) -> tuple[int, ...]:
        """Seed of every random choice."""
        return self.settings.seed, 0

    def footage(self) -> tuple[Footage, None]:
        """Return the picture to fit; nothing is behind it."""
        return Footage(self.frames, np.zeros(1, np.float32), shown=self.shown), None

    def payload(
        self, gop: Gop, precision: Precision, codecs: Collection[Codec], visible: Visible | None
    ) -> bytes:
        """Return the payload of the background chunk."""
        return pack_background(self.number, gop, precision, codecs)


@dataclass(frozen=True, slots=True, eq=False)
class EncodedGop:
    """A finished GOP or background."""

    payload: bytes  #: of its chunk
    psnr: float  #: dB, mean of the frames that a decoder will show
    float_psnr: float  #: dB, the same before quantisation


def encode_gop(job: Job) -> EncodedGop:
    """Fit, quantise and pack one GOP or background.

    The same job gives the same bytes in any process and any order, unless it is timed.
    """
    began = time.perf_counter()
    settings, budget, options = job.settings, job.budget, job.options
    backend = backend_on(choose_device(settings.device), settings.threads)
    footage, visible = job.footage()

    def fit(gaussians: int, share: float = 1.0) -> Fit:
        """Fit so many Gaussians with a share of the job's effort."""
        seconds = None
        if job.seconds is not None:
            seconds = share * EFFORT.fitting_share * job.seconds - (time.perf_counter() - began)
        effort = Allowance(share * job.steps, seconds)
        return fit_gop(footage, gaussians, job.grid, options, effort, backend, seed=job.seed)

    def size(gop: Gop, precision: Precision, exact: bool) -> int:
        """Return the bytes of the payload; not `exact` = without the slow codecs."""
        pack = "entropy" if settings.pack == "auto" and not exact else settings.pack
        return len(job.payload(gop, precision, PACKS[pack], visible))

    if budget.target_psnr is None:
        fitted = fit(budget.gaussians)
    else:
        refits = RATE_CONTROL.refits if job.seconds is None else 0
        most = most_gaussians(job.size)
        fitted = fit_to_psnr(fit, budget.target_psnr, budget.gaussians, most, refits=refits)
    if options.profile == "paper":
        stored = as_published(fitted, footage, backend)
    else:
        candidate = quantisable(fitted, footage, options, backend, size, seed=job.seed)
        if budget.target_bytes is not None:
            stored = quantise_to_size(candidate, budget.target_bytes)
        elif budget.target_psnr is not None:
            stored = quantise_to_psnr(candidate, budget.target_psnr)
        else:
            stored = candidate.quantised(candidate.usual_qscale)
    payload = job.payload(stored.gop, stored.precision, PACKS[settings.pack], visible)
    return EncodedGop(payload, stored.psnr, fitted.psnr)
