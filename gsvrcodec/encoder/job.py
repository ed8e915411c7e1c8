"""What the encoding of one GOP needs; apart, so that PyTorch is loaded where GOPs are fitted."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.encoder.plan import Budget, halved, triplane_grid
from gsvrcodec.encoder.rate import visited_frames
from gsvrcodec.encoder.settings import EncodeSettings, Execution
from gsvrcodec.fit.footage import Picture
from gsvrcodec.fit.recipe import FitOptions
from gsvrcodec.model.gop import Gop, GridSize
from gsvrcodec.model.plate import Plate
from gsvrcodec.model.time import Ticks


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """The GOP that another is predicted from, as a decoder has it."""

    gop: Gop
    first_frame: int  #: number of its first frame in the file
    frames: int
    qscale: float  #: that it was stored at
    psnr: float  #: dB, mean of its frames
    plate: Plate | None = None  #: behind its Gaussians; None = none


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class GopJob:
    """All that `encode_gop` needs."""

    frames: NDArray[np.uint8]  #: (F, H, W, 3) RGB
    pts: Ticks  #: (F,) ticks
    durations: Ticks  #: (F,) ticks
    first_frame: int  #: number of the first frame in the file
    budget: Budget
    settings: EncodeSettings
    execution: Execution = field(default_factory=Execution)
    seconds: float | None = None  #: wall time to spend; None = by the preset
    reference: Reference | None = None  #: None = a key GOP
    before: Picture | None = None  #: (H, W, 3) RGB last frame of the reference, of the source
    plate: bytes | None = None  #: coded, for a key GOP; None = none is known
    alone: bool = False  #: whether it is all of its chain, in which a plate has been looked for

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, pixels."""
        return self.frames.shape[2], self.frames.shape[1]

    @property
    def steps(self) -> int:
        """Optimiser steps, without `seconds`."""
        frames = visited_frames(len(self.frames))
        return round(self.settings.frame_visits * frames)

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
