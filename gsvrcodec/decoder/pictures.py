"""Rendering of GOPs to pictures of the requested size, bit depth and layers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import isfinite
from typing import Any, cast, get_args

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.bitstream.gop_chain import WholeGop
from gsvrcodec.decoder.gop_cache import ReadyGop
from gsvrcodec.errors import UsageError
from gsvrcodec.limits import Limits
from gsvrcodec.model.gop import Float32Array, Gop
from gsvrcodec.model.layers import Layers, dynamic, select_layers
from gsvrcodec.model.passage import Passage
from gsvrcodec.model.plate import Plate
from gsvrcodec.model.static import select_gaussians
from gsvrcodec.model.time import normalised_time, time_at
from gsvrcodec.render import Backend, Codes, Prepared, as_tensor, empty_frames
from gsvrcodec.render.order import arranged

#: Width and height in pixels, where -1 keeps the aspect ratio and -2 also rounds to an even number;
#: or a factor for both.
RequestedSize = tuple[int, int] | float

#: Mean absolute difference of two frames that makes a cut between them, white = 1.
_CUT_DIFFERENCE = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureMaker:
    """Renders the GOPs of one video, all pictures with the same bit depth and layers."""

    coded_size: tuple[int, int]  #: width and height of the coded frame, pixels
    size: tuple[int, int]  #: default width and height of the pictures, pixels
    layers: Layers  #: which Gaussians to draw
    bit_depth: int  #: bits a sample, 8 to 16
    backend: Backend  #: the renderer
    tensors: bool = False  #: pictures are torch tensors on the backend's device, not arrays
    planar: bool = False  #: channels of 8-bit pictures of the CPU are planes in memory

    def __post_init__(self) -> None:
        """Raise a UsageError for unknown layers or a bit depth out of range."""
        if self.layers not in get_args(Layers):
            raise UsageError(
                f"`layers` must be one of {', '.join(get_args(Layers))}, not {self.layers!r}"
            )
        if not 8 <= self.bit_depth <= 16:
            raise UsageError(f"the bit depth must be 8 to 16, not {self.bit_depth}")

    def prepare(self, gop: Gop) -> Prepared:
        """Return the chosen layers of a GOP, ready to be rendered."""
        chosen = select_layers(gop, self.layers, self.coded_size)
        return self.backend.prepare(arranged(chosen, self.coded_size))

    def empty(self, count: int, size: tuple[int, int]) -> Codes:
        """Return uninitialised pictures of `size`, shape (count, H, W, 3)."""
        place = self.backend.device if self.tensors else "cpu"
        if self.planar and self.backend.device == "cpu" and self.bit_depth == 8:
            return np.empty((count, 3, size[1], size[0]), np.uint8).transpose(0, 2, 3, 1)
        return empty_frames(count, size, bit_depth=self.bit_depth, device=place)

    def given(self, pictures: Codes) -> Codes:
        """Return rendered pictures as they were asked for: arrays, or tensors in the same memory.

        Tensors too are typed as arrays; `Frame.tensor` is typed as what it is.
        """
        return cast(Codes, as_tensor(pictures)) if self.tensors else pictures

    def frames(
        self, gop: ReadyGop, inside: NDArray[np.int64], size: tuple[int, int], out: Codes
    ) -> None:
        """Render the frames `inside` (F,), counted from 0 in the GOP, to `out` (F, H, W, 3)."""
        taus = normalised_time(gop.pts)[inside]
        self._render(gop.prepared, taus, size, out, gop.whole.plate)

    def moments(
        self, gop: ReadyGop, ticks: Sequence[Fraction], size: tuple[int, int], out: Codes
    ) -> None:
        """Render a GOP at the times `ticks` (F,) to `out` (F, H, W, 3)."""
        taus = np.array([time_at(gop.pts, tick) for tick in ticks], np.float32)
        self._render(gop.prepared, taus, size, out, gop.whole.plate)

    def between(
        self,
        before: ReadyGop,
        after: ReadyGop,
        ticks: Sequence[Fraction],
        size: tuple[int, int],
        out: Codes,
    ) -> None:
        """Render the times `ticks` (F,) between a GOP and the next to `out` (F, H, W, 3).

        If the next GOP is predicted from this one, its Gaussians go from their place and look at
        the last frame to those at the first frame; other GOPs are cross-faded.
        """
        kept = after.whole.kept
        if kept is not None and after.whole.reference == before.position:
            self._pass(before.whole, after.whole, kept, ticks, size, out)
        else:
            self.fade(before, after, ticks, size, out)

    def fade(
        self,
        before: ReadyGop,
        after: ReadyGop,
        ticks: Sequence[Fraction],
        size: tuple[int, int],
        out: Codes,
    ) -> None:
        """Cross-fade the last frame of a GOP and the first of the next to `out` (F, H, W, 3).

        The weights are linear in the times `ticks` (F,), which lie between the two frames. If the
        frames differ by more than `_CUT_DIFFERENCE`, the last frame is held.
        """
        ends = empty_frames(2, size, bit_depth=self.bit_depth)
        self.moments(before, [Fraction(int(before.pts[-1]))], size, ends[:1])
        self.moments(after, [Fraction(int(after.pts[0]))], size, ends[1:])
        held, step = ends[0].astype(np.float32), ends[1].astype(np.float32) - ends[0]
        start, span = int(before.pts[-1]), int(after.pts[0]) - int(before.pts[-1])
        cut = float(np.abs(step).mean()) > _CUT_DIFFERENCE * (2**self.bit_depth - 1)
        for picture, tick in zip(out, ticks, strict=True):
            weight = 0.0 if cut else float((tick - start) / span)
            mixed = held + np.float32(weight) * step + np.float32(0.5)
            _fill(picture, mixed.astype(ends.dtype))

    def _pass(
        self,
        before: WholeGop,
        after: WholeGop,
        kept: NDArray[np.bool_],
        ticks: Sequence[Fraction],
        size: tuple[int, int],
        out: Codes,
    ) -> None:
        """Render a GOP on its way to one that is predicted from it and has its Gaussians `kept`."""
        frames = len(before.pts), len(after.pts)
        passage = Passage.of(before.gop, after.gop, kept, frames, self.backend.blending)
        chosen = None
        if self.layers != "all":
            moving = dynamic(after.gop, self.coded_size)
            dropped = dynamic(before.gop, self.coded_size)[~kept]
            chosen = np.concatenate([moving, dropped]) == (self.layers == "dynamic")
        start, span = int(before.pts[-1]), int(after.pts[0]) - int(before.pts[-1])
        for picture, tick in zip(out, ticks, strict=True):
            gop = passage.at(float((tick - start) / span))
            if chosen is not None:
                gop = select_gaussians(gop, chosen)
            prepared = self.backend.prepare(arranged(gop, self.coded_size))
            self._render(prepared, np.zeros(1, np.float32), size, picture[None], after.plate)

    def _render(
        self,
        prepared: Prepared,
        taus: Float32Array,
        size: tuple[int, int],
        out: Codes,
        plate: Plate | None,
    ) -> None:
        """Render a GOP at times `taus` (F,) into `out` (F, H, W, 3); a plate is static."""
        backend = self.backend.over(None if self.layers == "dynamic" else plate)
        backend.render(prepared, taus, size, self.coded_size, bit_depth=self.bit_depth, out=out)


def _fill(picture: Any, codes: Codes) -> None:
    """Copy samples into an array, or into a tensor on a GPU."""
    if isinstance(picture, np.ndarray):
        picture[:] = codes
    else:
        picture.copy_(picture.new_tensor(codes))


def picture_size(
    size: RequestedSize | None, coded: tuple[int, int], limits: Limits
) -> tuple[int, int]:
    """Return the width and height, in pixels, that a requested size stands for.

    Args:
        size: Requested size; None = as coded.
        coded: Width and height of the coded frame, pixels.
        limits: Limits on the size.

    Raises:
        UsageError: The size is invalid.
        LimitError: The size is over the limits.
    """
    width, height = _pixels(coded if size is None else size, coded)
    if width < 1 or height < 1:
        raise UsageError(f"a picture cannot be {width}x{height} pixels: each side needs 1 or more")
    limits.check("width", width, "the width of the pictures")
    limits.check("height", height, "the height of the pictures")
    limits.check("pixels", width * height, "the number of pixels of a picture")
    return width, height


def _pixels(size: RequestedSize, coded: tuple[int, int]) -> tuple[int, int]:
    """Return the width and height that `size` stands for, not yet checked."""
    if not isinstance(size, tuple):
        if not (isfinite(size) and size > 0):
            raise UsageError(f"a scale must be a number over 0, not {size}")
        return round(coded[0] * size), round(coded[1] * size)
    width, height = size
    if width < 0 and height < 0:
        raise UsageError("give the width or the height: both cannot follow from the other")
    if width < 0:
        width = _rounded_side(width, height * coded[0] / coded[1])
    elif height < 0:
        height = _rounded_side(height, width * coded[1] / coded[0])
    return width, height


def _rounded_side(step: int, exact: float) -> int:
    """Return the positive multiple of -step nearest to `exact`, the length of a side in pixels."""
    if step not in (-1, -2):
        raise UsageError(f"a side must be a number of pixels, -1 or -2, not {step}")
    return max(-step, -step * round(exact / -step))
