"""A chain of GOPs: each but the first is predicted from the one before, as a decoder has it."""

from __future__ import annotations

import time
from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from statistics import fmean

import numpy as np

from gsvrcodec.bitstream.gop_payload import unpack_gop
from gsvrcodec.bitstream.header import Header
from gsvrcodec.encoder.budget import Budget
from gsvrcodec.encoder.jobs import EncodedGop, GopJob, Reference
from gsvrcodec.encoder.packed import PackedPictures, Pictures
from gsvrcodec.encoder.rate import visited_frames
from gsvrcodec.encoder.settings import EncodeSettings
from gsvrcodec.encoder.shared import SharedPictures
from gsvrcodec.encoder.tuned import CHAIN
from gsvrcodec.fit.tuned import RATE_CONTROL
from gsvrcodec.limits import Limits
from gsvrcodec.model.time import Ticks


@dataclass(frozen=True, slots=True, eq=False)
class ChainFrames:
    """The frames of a chain, by GOP."""

    gops: Sequence[range]  #: numbers of the frames
    #: (F, H, W, 3) RGB of each; emptied as they go
    pictures: list[Pictures | PackedPictures | SharedPictures]
    pts: list[Ticks]  #: (F,) ticks of each
    durations: list[Ticks]  #: (F,) ticks of each

    def take(self, number: int) -> Pictures:
        """Return the pictures of a GOP, (F, H, W, 3), and let go of them."""
        found, self.pictures[number] = self.pictures[number], np.empty((0, 0, 0, 3), np.uint8)
        return found if isinstance(found, np.ndarray) else found.unpacked()


def chain_jobs(
    chain: ChainFrames,
    budgets: Sequence[Budget],
    settings: EncodeSettings,
    finished: Sequence[EncodedGop],
    seconds: float | None,
) -> Generator[GopJob, EncodedGop, None]:
    """Yield the job of each GOP; is sent the result before it yields the next one.

    Args:
        chain: the frames; finished GOPs need none.
        budgets: of each GOP; bytes that one GOP leaves go to the next ones.
        settings: of the encode.
        finished: results of the first GOPs of the chain, which are not done again.
        seconds: wall time for the GOPs that are not finished; None = by the preset.
    """
    began = time.perf_counter()
    efforts = shared_efforts(list(map(len, chain.gops)))
    state = _State(settings, sum(budget.target_bytes or 0 for budget in budgets))
    overruns: list[float] = []  # seconds that GOPs took beyond their time, to start and to pack
    for number, (gop, budget) in enumerate(zip(chain.gops, budgets, strict=True)):
        if number < len(finished):
            state.add(finished[number], gop, budget)
            continue
        left = None
        if seconds is not None:
            waiting = [
                visited_frames(len(own)) * effort * planned.step_cost
                for own, effort, planned in zip(chain.gops, efforts, budgets, strict=True)
            ][number:]
            spent = time.perf_counter() - began + len(waiting) * fmean(overruns or [0.0])
            left = max(0.0, seconds - spent) * waiting[0] / sum(waiting)
        job = GopJob(
            frames=chain.take(number),
            pts=chain.pts[number],
            durations=chain.durations[number],
            first_frame=gop.start,
            budget=state.budget(budget, budgets[number:]),
            settings=settings,
            effort=efforts[number],
            seconds=left,
            reference=state.reference,
        )
        asked = time.perf_counter()
        result = yield job
        del job
        overruns.append(max(0.0, time.perf_counter() - asked - (left or 0.0)))
        if number + 1 < len(chain.gops):
            state.add(result, gop, budget)


def shared_efforts(lengths: Sequence[int]) -> list[float]:
    """Effort for a visited frame of each GOP of a chain; 1 in the mean of all of them.

    Args:
        lengths: frames of each GOP.
    """
    weights = np.ones(len(lengths))
    weights[0] = CHAIN.key_effort
    frames = np.array(list(map(visited_frames, lengths)))
    efforts: list[float] = (weights * frames.sum() / (weights @ frames)).tolist()
    return efforts


class _State:
    """What a chain has come to: its last GOP as a decoder has it, and bytes left."""

    def __init__(self, settings: EncodeSettings, target_bytes: int) -> None:
        self._settings = settings
        self._left = target_bytes
        self._spare = 0.0
        self.reference: Reference | None = None  #: of the next GOP

    def add(self, result: EncodedGop, gop: range, budget: Budget) -> None:
        """Count a finished GOP, and take it for the reference of the next one."""
        self._left -= len(result.payload)
        if budget.target_psnr is not None:
            self._spare = result.float_psnr - budget.target_psnr - RATE_CONTROL.rounding_loss
        if not self._settings.predicts or result.qscale is None:
            return
        content = unpack_gop(result.payload, _ANY, Limits())
        before = self.reference
        whole = content.new
        if before is not None and content.carried is not None:
            whole = content.gop(before.gop, before.frames)
        self.reference = Reference(whole, gop.start, len(gop), result.qscale, result.psnr)

    def budget(self, planned: Budget, rest: Sequence[Budget]) -> Budget:
        """Return a GOP's budget, by what is left for it and the `rest`, which begins with it."""
        if planned.target_bytes is not None:
            wanted = sum(budget.target_bytes or 0 for budget in rest)
            share = max(self._left, 0) * planned.target_bytes / max(wanted, 1)
            exact = len(rest) == 1
            count = len(self.reference.gop) if self.reference else planned.gaussians
            return replace(planned, gaussians=count, target_bytes=max(1, int(share)), exact=exact)
        if planned.slope is not None and self.reference is not None:
            return replace(planned, gaussians=len(self.reference.gop))
        if planned.target_psnr is not None and self.reference is not None:
            now = len(self.reference.gop)
            aim = sum(RATE_CONTROL.spare) / 2
            octaves = min(max(aim - self._spare, -1.0), 1.0) / RATE_CONTROL.octave
            return replace(planned, gaussians=max(1, round(now * 2**octaves)))
        return planned


#: A header whose maxima no GOP of our own exceeds.
_ANY = Header(
    width=1,
    height=1,
    time_base=Fraction(1),
    max_gaussians=2**32 - 1,
    max_gop_frames=2**32 - 1,
    max_grid=(2**16 - 1,) * 3,
)
