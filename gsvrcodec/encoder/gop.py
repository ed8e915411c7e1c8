"""Encoding of one GOP: frames in, chunk payload out; a pure function of its job."""

from __future__ import annotations

import math
import time
from collections import defaultdict
from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.bitstream.attribute_planes import Memories
from gsvrcodec.bitstream.gop_payload import pack_gop, unpack_plate
from gsvrcodec.encoder.job import GopJob
from gsvrcodec.encoder.plan import fittable
from gsvrcodec.encoder.plates import gop_plate
from gsvrcodec.encoder.results import EncodedGop
from gsvrcodec.fit.fitting import Allowance, Fit, fit_gop
from gsvrcodec.fit.footage import Footage
from gsvrcodec.fit.paper import as_published, fit_as_published
from gsvrcodec.fit.parameters import LOOK
from gsvrcodec.fit.plate import shows
from gsvrcodec.fit.predicted import LastFrame, fit_predicted
from gsvrcodec.fit.quantise import quantisable
from gsvrcodec.fit.start import affordable
from gsvrcodec.fit.target import Quality, Size
from gsvrcodec.fit.tuned import EFFORT, PLATE, PREDICTION, RATE_CONTROL
from gsvrcodec.model.gop import Float32Array, Gop
from gsvrcodec.model.plate import Plate
from gsvrcodec.model.prediction import CHANGED, DROPPED, MOVED, Carried, last_look, last_time
from gsvrcodec.model.quantise import Precision, of_carried
from gsvrcodec.model.static import select_gaussians
from gsvrcodec.model.time import normalised_time
from gsvrcodec.planes import PACKS, Memory
from gsvrcodec.render import backend_on
from gsvrcodec.render.device import choose_device


def encode_gop(job: GopJob) -> EncodedGop:
    """Fit, quantise and pack one GOP.

    The same job gives the same bytes in any process and any order, unless it is timed.
    """
    fitter = _Fitter(job)
    fitted = fitter.predicted() or fitter.key()
    job = fitter.job
    packer = _Packer(job, fitted, fitter.plate)
    if job.settings.profile == "paper":
        stored = as_published(fitted, fitter.backend)
    else:
        candidate = quantisable(
            fitted,
            job.options,
            fitter.backend,
            packer.size,
            seed=job.seed,
            slope=job.budget.slope,
        )
        before = job.reference.qscale if job.reference and fitted.anchor else None
        stored = job.budget.target.quantise(candidate, before)
    payload = packer.payload(stored.gop, stored.precision)
    return EncodedGop(
        frames=range(job.first_frame, job.first_frame + len(job.frames)),
        psnr=stored.psnr,
        float_psnr=fitted.psnr,
        seconds=time.perf_counter() - fitter.began,
        qscale=stored.qscale,
        plate_bytes=len(fitter.plate or b""),
        payload=payload,
    )


class _Fitter:
    """Makes the fit of a job; its time runs from construction."""

    def __init__(self, job: GopJob) -> None:
        self.began = time.perf_counter()
        self.job, execution = job, job.execution  #: changes if the GOP gets a plate
        self._footage = Footage(job.frames, normalised_time(job.pts))
        self.backend = backend_on(
            choose_device(execution.device), execution.threads, job.settings.blending
        )
        self.plate: bytes | None = None  #: that the GOP stores

    def predicted(self) -> Fit | None:
        """Predict from the reference; None if there is none, or if it has lost the frames."""
        job, reference = self.job, self.job.reference
        if reference is None or job.before is None:
            return None
        budget, backend = job.budget, self.backend.over(reference.plate)
        last = np.array([last_time(reference.frames)], np.float32)
        shown = backend.render(backend.prepare(reference.gop), last, job.size, job.size)[0]
        look = last_look(reference.gop, reference.frames)
        qscale = reference.qscale if budget.slope is None else budget.slope.stored_qscale
        gaussians = budget.gaussians if budget.slope is None else len(reference.gop)
        allowance = self._allowance(min(gaussians, self._fittable))
        fit = fit_predicted(
            self._footage,
            LastFrame(look, shown, job.before, qscale, reference.psnr),
            gaussians,
            job.grid,
            job.options,
            allowance,
            backend,
            seed=job.seed,
            slope=budget.slope,
            least_kept=0.0 if budget.predicted else PREDICTION.kept,
        )
        if fit is not None:
            self.backend = backend
        return fit

    def key(self) -> Fit:
        """Fit a key GOP to what the budget asks for; once more if it falls short of a quality."""
        self._take_plate()
        fit, target = self._key(), self.job.budget.target
        if isinstance(target, Quality) and self.job.seconds is None:
            job, finer = self.job, target.finer(fit.psnr)
            if finer is not None:
                self.job = replace(job, budget=replace(job.budget, target=finer))
                again = self._key()
                if again.psnr > fit.psnr:
                    return again
                self.job = job
        return fit

    def _key(self) -> Fit:
        """Fit a key GOP."""
        job, gaussians = self.job, self.job.budget.gaussians
        effort = self._allowance(gaussians)
        what = self._footage, gaussians, job.grid, job.options, effort, self.backend
        if job.settings.profile == "paper":
            return fit_as_published(*what, seed=job.seed)
        return fit_gop(*what, seed=job.seed, slope=job.budget.slope)

    def _take_plate(self) -> None:
        """Take a plate for a key GOP, if one pays; then it is most of what lasts."""
        job, slope = self.job, self.job.budget.slope
        if slope is None or not job.settings.plates:
            return
        coded, plate = job.plate, None
        if coded is not None:
            plate = _unpacked(coded, job.size)
        if plate is None and (job.alone or isinstance(job.budget.target, Size)):
            return
        if plate is None or not shows(job.frames, plate.shown()):
            each = None if job.seconds is None else job.seconds / len(job.frames)
            coded = gop_plate(job.frames, slope, each)
            plate = None if coded is None else unpack_plate(coded, job.size)
        if plate is None:
            return
        self.plate, self.backend = coded, self.backend.over(plate)
        count = max(1, round(PLATE.gaussians * job.budget.gaussians))
        beside = len(self.plate or b"") if coded is job.plate else 0
        qscale = max(PLATE.finer * slope.qscale, RATE_CONTROL.finest)
        budget = job.budget.beside_plate(replace(slope, qscale=qscale, lasting=1.0), beside)
        grid = affordable(job.grid, math.ceil(PLATE.left * count), job.settings.blending)
        budget = replace(budget, gaussians=count, grid=grid)
        self.job = replace(job, budget=budget)

    @property
    def _fittable(self) -> float:
        """Gaussians that the job's time suffices for; inf = it has no wall time."""
        job = self.job
        return math.inf if job.seconds is None else fittable(job.seconds, job.execution)

    def _allowance(self, gaussians: float) -> Allowance:
        """Return the job's effort, without the time that packing so many takes."""
        job, seconds = self.job, None
        if job.seconds is not None:
            each = EFFORT.packing_seconds + job.budget.target.searches * EFFORT.search_seconds
            packing = min(each * gaussians, EFFORT.packing_share * job.seconds)
            seconds = job.seconds - packing - (time.perf_counter() - self.began)
        return Allowance(job.steps, seconds, self._fittable)


@lru_cache(maxsize=1)
def _unpacked(coded: bytes, size: tuple[int, int]) -> Plate:
    """Return a plate; the last one is kept, for the GOPs of a chain have the same."""
    return unpack_plate(coded, size)


class _Packer:
    """Packs what is stored of a fit."""

    def __init__(self, job: GopJob, fitted: Fit, plate: bytes | None) -> None:
        self._job, self._fitted, self._plate = job, fitted, plate
        self._reference = 0  # distance in frames; 0 = a key GOP
        if job.reference is not None and fitted.anchor is not None:
            self._reference = job.first_frame - job.reference.first_frame
        self._memories: Memories = defaultdict(Memory)

    def payload(self, gop: Gop, precision: Precision) -> bytes:
        """Return the payload of the GOP chunk."""
        # The best choice of codecs is 0.1 to 0.4 % smaller, but takes a tenth of a short wall time.
        final = None if self._job.seconds is None else self._memories
        return self._packed(gop, precision, self._job.settings.pack, final)

    def size(self, gop: Gop, precision: Precision, exact: bool) -> int:
        """Return the bytes of the payload; not `exact` = by a quick choice of codecs."""
        if exact:
            return len(self.payload(gop, precision))
        pack = self._job.settings.pack
        quick = "entropy" if pack == "auto" else pack
        return len(self._packed(gop, precision, quick, self._memories))

    def _packed(
        self, gop: Gop, precision: Precision, codecs: str, memories: Memories | None
    ) -> bytes:
        job = self._job
        return pack_gop(
            new_of(self._fitted, gop),
            job.pts,
            job.durations,
            job.first_frame,
            precision,
            PACKS[codecs],
            reference=self._reference,
            carried=carried_of(self._fitted, gop, precision),
            memories=memories,
            blending=job.settings.blending,
            plate=self._plate,
        )


def carried_of(fit: Fit, gop: Gop, precision: Precision) -> Carried | None:
    """Return how the Gaussians of the reference go on; None for a key GOP.

    A Gaussian whose changes round to nothing has none, and so has a motion.

    Args:
        fit: a predicted fit.
        gop: its Gaussians as they are to be stored.
        precision: quantiser steps.
    """
    if fit.anchor is None or fit.kept is None:
        return None
    numbers = np.flatnonzero(fit.anchor.carried)
    numbers = numbers[np.argsort(fit.anchor.source[numbers])]
    gop, precision = select_gaussians(gop, numbers), of_carried(precision)
    turn = np.pi / fit.anchor.units.rotation[numbers]  # half a circle
    values = {name: getattr(gop, name) for name in LOOK}
    values["rotation"] = (values["rotation"] + turn / 2) % turn - turn / 2

    def rounds_to_nothing(name: str, value: Float32Array) -> NDArray[np.bool_]:
        columns = value if value.ndim > 1 else value[:, None]
        return np.asarray(~np.rint(columns / np.array(precision[name])).any(axis=1))

    changed = ~np.logical_and.reduce([rounds_to_nothing(n, v) for n, v in values.items()])
    moving = {"linear": gop.linear, "quadratic": gop.quadratic, "indicator": 1 - gop.indicator}
    moved = ~np.logical_and.reduce([rounds_to_nothing(n, v) for n, v in moving.items()])
    mode = np.where(fit.kept, 0, DROPPED).astype(np.uint8)
    mode[fit.anchor.source[numbers]] = MOVED * moved + CHANGED * changed
    return Carried(
        mode,
        **{name: values[name][changed] for name in LOOK},
        **{name: getattr(gop, name)[moved] for name in ("indicator", "linear", "quadratic")},
    )


def new_of(fit: Fit, gop: Gop) -> Gop:
    """Return the Gaussians of a fit that do not come from the reference, and the tri-plane."""
    return gop if fit.anchor is None else select_gaussians(gop, ~fit.anchor.carried)
