"""Encoding of one GOP: frames in, chunk payload out; a pure function of its task."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from statistics import fmean

import numpy as np
import torch
from numpy.typing import NDArray

from gsvrcodec.bitstream.background_payload import pack_background
from gsvrcodec.bitstream.gop_payload import pack_gop
from gsvrcodec.encoder.background import shown_of, still_rgb
from gsvrcodec.encoder.plan import PSNR_OCTAVE, Budget, most_gaussians, triplane_grid
from gsvrcodec.encoder.settings import EncodeSettings, Pack
from gsvrcodec.fit.field import Field
from gsvrcodec.fit.flow import flow_estimator
from gsvrcodec.fit.optimise import MAIN, PAPER, Effort, optimise
from gsvrcodec.fit.precision import equal_slope_steps, usual_factor
from gsvrcodec.fit.qat import fake_quantiser
from gsvrcodec.fit.sensitivity import sensitivity
from gsvrcodec.fit.staged import settle
from gsvrcodec.fit.start import content_aware, random_start
from gsvrcodec.fit.static import with_still
from gsvrcodec.fit.target import Target, find_factor
from gsvrcodec.metrics import psnr
from gsvrcodec.model.background import Background, only, together
from gsvrcodec.model.gop import Gop, GridSize
from gsvrcodec.model.quantise import PAPER_BITS, Precision, dequantised
from gsvrcodec.model.time import Ticks, normalised_time
from gsvrcodec.planes import PACKS
from gsvrcodec.render import render_frames
from gsvrcodec.render.device import choose_device
from gsvrcodec.render.native import render_linear

Shown = NDArray[np.bool_]

#: Visits of each frame, by preset.
FRAME_VISITS = {"fastest": 12, "fast": 40, "medium": 100, "slow": 400, "slowest": 1000}
_MIN_STEPS, _MIN_TUNING_STEPS = 100, 30
#: Of the fit of a background, for each visit that a frame gets; and its least steps.
_BACKGROUND_VISITS, _MIN_BACKGROUND_STEPS = 16, 200
#: Frames rendered together to measure their quality.
_AT_ONCE = 8
#: Part of the effort after which the publication's fit sees quantised values.
_QAT_FROM = 0.9
#: Part of the effort that goes into fine-tuning while rounding.
_TUNING = 0.12
#: What that leaves of what rounding costs (dB); trials to meet a quality, and when it is met (dB).
_LEFT, _MOST_TUNINGS, _NEAR = 0.62, 3, 0.04
#: Room for what fine-tuning may add to a size.
_SIZE_ROOM = 0.003
#: With a quality to meet: part of the effort of a first fit, that tells the number of Gaussians.
_PILOT = 1 / 6
#: What it lacks of a whole fit (dB) falls with its steps: by a factor, and to a power of them.
_PILOT_LACKS = 119.0, -0.65
#: What rounding costs at sensible steps, dB.
_ROUNDING_LOSS = 0.4
#: Quality before rounding that is right for a target, beyond what rounding costs, dB; otherwise
#: there is another fit, that aims at the middle, but no more than so many.
_SPARE, _MOST_REFITS = (-0.2, 0.8), 4


@dataclass(frozen=True, slots=True, eq=False)
class GopTask:
    """What `encode_gop` needs, and nothing else."""

    frames: NDArray[np.uint8]  #: (F, H, W, 3) RGB
    pts: Ticks  #: (F,) ticks
    durations: Ticks  #: (F,) ticks
    first_frame: int  #: number of the first frame in the file
    gaussians: int  #: N; with a quality to meet a first guess
    settings: EncodeSettings
    seconds: float | None  #: wall time to spend; None = by the preset
    target_bytes: int | None = None  #: of the payload; None = what it comes to
    target_psnr: float | None = None  #: dB, mean of the frames; None = what it comes to
    grid: GridSize | None = None  #: Gx, Gy, Gt of the tri-plane; None = the usual
    background: Background | None = None  #: what it may show of what other GOPs have too
    background_picture: bytes = b""  #: what the background was fitted to, a PNG file

    @property
    def steps(self) -> int:
        """Steps of the fit, if it does not go by time."""
        return FRAME_VISITS[self.settings.preset] * len(self.frames)

    @property
    def repeats(self) -> int:
        """How many frames show what each of these does."""
        return 1

    def pack(self, gop: Gop, precision: Precision, pack: Pack, shown: Shown | None) -> bytes:
        """The payload of what was fitted, and what it shows of the background."""
        return pack_gop(
            gop,
            self.pts,
            self.durations,
            self.first_frame,
            precision,
            PACKS[pack],
            background=0 if shown is None or self.background is None else self.background.number,
            shown=shown,
        )


@dataclass(frozen=True, slots=True, eq=False)
class BackgroundTask(GopTask):
    """A background to be fitted as if it were a GOP: its frames are one picture."""

    number: int = 1  #: by which GOPs name it
    shown: int = 1  #: frames of all these GOPs

    @property
    def repeats(self) -> int:
        """How many frames show what each of these does."""
        return self.shown

    @property
    def steps(self) -> int:
        """Steps of the fit, if it does not go by time."""
        return max(_MIN_BACKGROUND_STEPS, _BACKGROUND_VISITS * FRAME_VISITS[self.settings.preset])

    def pack(self, gop: Gop, precision: Precision, pack: Pack, shown: Shown | None) -> bytes:
        """The payload of what was fitted."""
        return pack_background(self.number, gop, precision, PACKS[pack])


def background_task(
    number: int, picture: NDArray[np.uint8], shown: int, budget: Budget, settings: EncodeSettings
) -> BackgroundTask:
    """Return what to fit to a picture (H, W, 3) that GOPs of so many frames will share."""
    return BackgroundTask(
        frames=picture[None],
        pts=np.zeros(1, np.int64),
        durations=np.zeros(1, np.int64),
        first_frame=0,
        settings=replace(settings, deform="polynomial"),
        seconds=None,
        number=number,
        shown=shown,
        **asdict(budget),
    )


@dataclass(frozen=True, slots=True, eq=False)
class EncodedGop:
    """A finished GOP."""

    payload: bytes  #: of the GOP chunk
    psnr: float  #: dB, mean of the frames that a decoder will show
    float_psnr: float  #: dB, the same before quantisation


def encode_gop(task: GopTask) -> EncodedGop:
    """Fit, quantise and pack one GOP.

    The same task gives the same bytes in any process and any order, unless it is timed.
    """
    began = time.perf_counter()
    gaussians, behind = task.gaussians, _behind(task)
    if task.target_psnr is not None:
        pilot = _Fitted(task, gaussians, behind, share=_PILOT)
        wanted = task.target_psnr + _ROUNDING_LOSS + fmean(_SPARE)
        gaussians = pilot.more(wanted - pilot.float_psnr() - pilot.to_come())
    fitted = _Fitted(task, gaussians, behind, spent=time.perf_counter() - began)
    if task.target_psnr is not None and task.seconds is None:
        for _ in range(_MOST_REFITS):
            spare = fitted.float_psnr() - task.target_psnr - _ROUNDING_LOSS
            gaussians = fitted.more(fmean(_SPARE) - spare)
            if _SPARE[0] <= spare <= _SPARE[1] or gaussians == fitted.gaussians:
                break
            fitted = _Fitted(task, gaussians, behind)
    return fitted.encoded()


@dataclass(frozen=True, slots=True, eq=False)
class _Behind:
    """What a GOP shows of its background; None = nothing."""

    shown: Shown | None = None  #: which Gaussians
    still: Gop | None = None  #: those Gaussians


def _behind(task: GopTask) -> _Behind:
    """Return what a GOP shows of its background."""
    if task.background is None:
        return _Behind()
    shown = shown_of(task.background, still_rgb(task.background_picture), task.frames)
    return _Behind(shown, only(task.background.gop, shown)) if shown.any() else _Behind()


class _Fitted:
    """A fit of a GOP, and what is stored of it."""

    def __init__(
        self,
        task: GopTask,
        gaussians: int,
        behind: _Behind,
        *,
        share: float = 1.0,
        spent: float = 0.0,
    ) -> None:
        """Fit.

        Args:
            task: what to encode.
            gaussians: N.
            behind: what is shown of the background.
            share: part of the task's effort to spend; less than 1 is for a trial.
            spent: wall time that the task has taken so far, seconds.
        """
        began = time.perf_counter()
        self._task, settings, frames = task, task.settings, task.frames
        self._shown, self._still = behind.shown, behind.still
        self.gaussians = gaussians
        self._taus = taus = normalised_time(task.pts)
        self._size = size = frames.shape[2], frames.shape[1]
        rng = np.random.default_rng([settings.seed, task.first_frame])
        self._paper = settings.profile == "paper"
        grid = task.grid or triplane_grid(size, len(frames), settings)
        if self._paper:
            start = random_start(frames, gaussians, grid, rng)
        else:
            flow = None if settings.deform == "triplane" else flow_estimator(settings.flow)
            backdrop = None
            if behind.still is not None:
                backdrop = render_linear(behind.still, 0.0, size, size, settings.threads)
            start = content_aware(frames, taus, gaussians, grid, flow, rng, backdrop)
        self._field = Field(start, settings.deform, choose_device(settings.device), behind.still)
        steps = share * task.steps
        seconds = None
        self._tuning_seconds = None
        tuning = 0.0 if self._paper or not settings.qat else _TUNING
        if task.seconds is not None:
            # Packing takes its share too.
            left = share * 0.92 * task.seconds - spent - (time.perf_counter() - began)
            seconds = max(0.1, (1 - tuning) * left)
            self._tuning_seconds = max(0.1, tuning * left)
        self._tuning_steps = max(_MIN_TUNING_STEPS, round(tuning * steps)) if tuning else 0
        self._effort = Effort(max(_MIN_STEPS, round((1 - tuning) * steps)), seconds)
        with _single_torch_thread():
            optimise(
                self._field,
                frames,
                taus,
                PAPER if self._paper else MAIN,
                self._effort,
                rng,
                quantise=fake_quantiser(PAPER_BITS) if self._paper and settings.qat else None,
                quantise_from=_QAT_FROM,
                threads=settings.threads,
            )

    def float_psnr(self) -> float:
        """Quality before quantisation, dB."""
        return self._quality(self._field.gop())

    def to_come(self) -> float:
        """Quality that a pilot lacks of a whole fit, dB."""
        scale, power = _PILOT_LACKS
        return float(scale * self._effort.expected_steps**power)

    def more(self, gain: float) -> int:
        """Gaussians that would reach `gain` dB more."""
        wanted = self.gaussians * 2 ** (min(max(gain, -9.0), 9.0) / PSNR_OCTAVE)
        return min(max(1, round(wanted)), most_gaussians(self._size))

    def encoded(self) -> EncodedGop:
        """Round and pack the fit."""
        gop = self._field.gop()
        float_psnr = self._quality(gop)
        stored, precision = (gop, PAPER_BITS) if self._paper else self._rounded(gop, float_psnr)
        return EncodedGop(
            payload=self._pack(stored, precision, self._task.settings.pack),
            psnr=self._quality(dequantised(stored, precision)),
            float_psnr=float_psnr,
        )

    def _rounded(self, gop: Gop, float_psnr: float) -> tuple[Gop, Precision]:
        """What is stored of the fit, and the precision that meets the target."""
        task = self._task
        rng = np.random.default_rng([task.settings.seed, task.first_frame])
        changes = sensitivity(
            gop, self._taus, self._size, rng, task.settings.threads, repeats=task.repeats
        )
        pack = task.settings.pack
        quick: Pack = "entropy" if pack == "auto" else pack

        def stored(factor: float) -> tuple[Gop, Precision]:
            return with_still(gop, changes, factor), equal_slope_steps(changes, factor)

        def size(factor: float, pack: Pack = quick) -> int:
            return len(self._pack(*stored(factor), pack))

        def quality(factor: float) -> float:
            return self._quality(dequantised(*stored(factor)))

        factor = usual_factor(task.repeats * task.frames[..., 0].size, self.gaussians, float_psnr)
        if task.target_bytes is not None:
            wanted = round((1 - _SIZE_ROOM) * task.target_bytes)
            factor = find_factor(size, Target.of_size(wanted), factor)
            if quick != pack:
                wanted += size(factor) - size(factor, pack)
                factor = find_factor(size, Target.of_size(wanted), factor)
        elif task.target_psnr is not None:
            return self._at_quality(float_psnr, stored, quality, factor)
        return self._tuned(*stored(factor))

    def _at_quality(
        self,
        float_psnr: float,
        stored: Callable[[float], tuple[Gop, Precision]],
        quality: Callable[[float], float],
        factor: float,
    ) -> tuple[Gop, Precision]:
        """What meets the wanted quality once it is fine-tuned."""
        wanted, left = self._task.target_psnr or 0.0, _LEFT if self._tuning_steps else 1.0
        trials = _MOST_TUNINGS if self._tuning_steps else 1
        if self._tuning_seconds is not None:
            self._tuning_seconds /= trials
        for _ in range(trials):
            loss = max(0.0, float_psnr - wanted) / left
            factor = find_factor(quality, Target.of_psnr(float_psnr - loss), factor)
            result, precision = self._tuned(*stored(factor))
            reached = self._quality(dequantised(result, precision))
            if abs(reached - wanted) < _NEAR or not loss:
                break
            left = min(max(0.2, (float_psnr - reached) / loss), 1.0)
        return result, precision

    def _tuned(self, stored: Gop, precision: Precision) -> tuple[Gop, Precision]:
        """Round what is stored, and have what is rounded last make up for the rest."""
        task, settings = self._task, self._task.settings
        if not self._tuning_steps:
            return stored, precision
        rng = np.random.default_rng([settings.seed, task.first_frame, 1])
        with _single_torch_thread():
            result = settle(
                stored,
                precision,
                task.frames,
                self._taus,
                MAIN,
                self._tuning_steps,
                self._tuning_seconds,
                rng,
                deform=settings.deform,
                device=self._field.device,
                threads=settings.threads,
                still=self._still,
            )
        return result, precision

    def _pack(self, gop: Gop, precision: Precision, pack: Pack) -> bytes:
        return self._task.pack(gop, precision, pack, self._shown)

    def _quality(self, gop: Gop) -> float:
        """Mean PSNR over the frames, dB."""
        frames, settings = self._task.frames, self._task.settings
        if self._still is not None:
            gop = together(gop, self._still)
        values: list[float] = []
        for begin in range(0, len(frames), _AT_ONCE):
            part = slice(begin, begin + _AT_ONCE)
            pictures = render_frames(
                gop,
                self._taus[part],
                self._size,
                self._size,
                threads=settings.threads,
                device=self._field.device,
            )
            values += map(psnr, pictures, frames[part])
        return fmean(values)


@contextmanager
def _single_torch_thread() -> Iterator[None]:
    """Keep torch's own threads from spinning beside the core's."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
