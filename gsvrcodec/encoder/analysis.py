"""Statistics of each frame: motion, detail, change, cuts (paper, "Dynamic-aware Time Slicing")."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterable, Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass
from operator import index
from statistics import median
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from gsvrcodec.encoder.paths import Paths
from gsvrcodec.encoder.tuned import ANALYSIS
from gsvrcodec.fit.motion import FlowEstimator, FlowField, Image, lengths, resize
from gsvrcodec.fit.start import density


@dataclass(frozen=True, slots=True)
class FrameStats:
    """Statistics of one frame against the frame before it."""

    motion: float  #: motion degree: mean length of the flow, px of the analysed frame
    cut: bool  #: a new shot begins, or a picture that rested has changed at once
    #: mean squared difference to the motion-compensated frame before, squared 8-bit codes
    change: float = 0.0
    detail: float = 0.0  #: mean squared gradient, squared 8-bit codes
    #: fraction of the picture that is not as it was some frames before, weighted by where Gaussians
    #: lie, for pictures of each of `ANALYSIS.qualities`
    changed: tuple[float, ...] = (1.0,) * len(ANALYSIS.qualities)
    fast: float = 0.0  #: length of the flow that 1 % of the pixels exceed, px of the analysed frame
    #: what one moving picture leaves of the frames of a GOP that ends with this one: mean squared
    #: error for each of `PATHS.lengths` up to the start of the shot, squared 8-bit codes; or empty
    left: tuple[float, ...] = ()

    def changed_at(self, psnr: float) -> float:
        """Return the fraction that is not as it was, for pictures of a quality, dB."""
        return float(np.interp(psnr, ANALYSIS.qualities, self.changed))


@dataclass(frozen=True, slots=True)
class Analysis:
    """What the first pass over the source found of every frame."""

    stats: tuple[FrameStats, ...]
    pts: tuple[int, ...]  #: ticks
    durations: tuple[int, ...]  #: ticks
    checksums: tuple[int, ...] = ()  #: CRC-32 of the samples; empty = not asked for

    def to_json(self) -> dict[str, Any]:
        """Return the analysis as JSON can hold it."""
        return asdict(self)

    @classmethod
    def from_json(cls, value: Any) -> Analysis | None:
        """Return an analysis from JSON; None if it has another shape."""
        with suppress(KeyError, TypeError):
            several = ("changed", "left")
            frames = (
                frame | {name: tuple(frame[name]) for name in several} for frame in value["stats"]
            )
            numbers = [tuple(map(index, value[name])) for name in ("pts", "durations", "checksums")]
            found = cls(tuple(FrameStats(**frame) for frame in frames), *numbers)
            if {len(found.stats)} == {len(found.pts), len(found.durations)}:
                return found
        return None


def analyse(frames: Iterable[Image], estimate: FlowEstimator) -> Iterator[FrameStats]:
    """Yield the statistics of each frame; the first counts as a cut.

    Args:
        frames: (H, W, 3) uint8, read one at a time.
        estimate: optical flow.
    """
    shot: deque[Image] = deque(maxlen=ANALYSIS.lag)  # the last frames before, since a cut
    previous: Image | None = None
    differences: deque[float] = deque(maxlen=ANALYSIS.resting)  # of the last frames of a shot
    usual: float | None = None  # running mean of the difference between frames of a shot
    paths = Paths()
    for frame in frames:
        small = resize(frame, ANALYSIS.height)
        detail = _detail(small)
        if previous is None:
            paths.add(small, None)
            yield FrameStats(0.0, True, 0.0, detail)
        else:
            difference = float(cv2.absdiff(previous, small).mean())
            new = (
                difference > ANALYSIS.cut_difference
                and difference > ANALYSIS.cut_ratio * (usual or 0.0)
                and _histogram_correlation(previous, small) < ANALYSIS.cut_correlation
            )
            cut = new or _jumps(difference, differences)
            if cut:
                shot.clear()
                paths = Paths()
                paths.add(small, None)
                yield FrameStats(0.0, True, 0.0, detail)
            else:
                flow = estimate(previous, small)
                missed, length = _missed(previous, small, flow), lengths(flow)
                motion, fast = float(length.mean()), float(np.percentile(length, 99))
                changed = _changed(shot[0], small, missed)
                left = paths.add(small, flow)
                yield FrameStats(motion, False, float(missed.mean()), detail, changed, fast, left)
            if new:
                differences.clear()
                usual = None
            else:
                differences.append(difference)
                usual = difference if usual is None else (usual + difference) / 2
        previous = small
        shot.append(small)


def _jumps(difference: float, before: Collection[float]) -> bool:
    """Return whether a picture that rested has changed at once, as a page that is scrolled does.

    Args:
        difference: To the frame before.
        before: The same of the frames before it.
    """
    return (
        len(before) == ANALYSIS.resting
        and difference > ANALYSIS.cut_difference
        and difference > ANALYSIS.cut_ratio * median(before)
    )


def _detail(image: Image) -> float:
    values = image.astype(np.float32)
    gradients = (np.diff(values, axis=axis) for axis in (0, 1))
    return sum(float(np.square(g).mean()) if g.size else 0.0 for g in gradients)


def _changed(before: Image, image: Image, missed: NDArray[np.float32]) -> tuple[float, ...]:
    # Noise, which motion does not explain either, is no change that a GOP could follow.
    squares = _squares(before, image) - ANALYSIS.noise * missed
    near = np.maximum(cv2.boxFilter(squares, -1, 2 * (ANALYSIS.changed_px,)), 0)
    where = density(image[None])
    errors = [ANALYSIS.visible * 255.0**2 / 10 ** (psnr / 10) for psnr in ANALYSIS.qualities]
    return tuple(float((where * np.minimum(near / error, 1)).sum()) for error in errors)


def _missed(previous: Image, image: Image, flow: FlowField) -> NDArray[np.float32]:
    """Squared difference to the frame before where the flow leads, (H, W)."""
    y, x = np.indices(flow.shape[:2], np.float32)
    moved = cv2.remap(
        image, x + flow[..., 0], y + flow[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    return _squares(previous, np.asarray(moved, np.uint8))


def _squares(first: Image, second: Image) -> NDArray[np.float32]:
    squares: NDArray[np.float32] = np.square(second.astype(np.float32) - first).mean(axis=2)
    return squares


def _histogram_correlation(first: Image, second: Image) -> float:
    histograms = [
        cv2.calcHist([image], [0, 1, 2], None, [8, 8, 8], [0, 256] * 3) for image in (first, second)
    ]
    return float(cv2.compareHist(histograms[0], histograms[1], cv2.HISTCMP_CORREL))
