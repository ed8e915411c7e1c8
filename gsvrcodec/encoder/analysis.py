"""Statistics of each frame: motion, detail, change, cuts (paper, "Dynamic-aware Time Slicing")."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from gsvrcodec.encoder.tuned import ANALYSIS
from gsvrcodec.fit.flow import FlowEstimator, FlowField, Image, lengths, resize
from gsvrcodec.fit.start import gradient


@dataclass(frozen=True, slots=True)
class FrameStats:
    """Statistics of one frame against the frame before it."""

    motion: float  #: motion degree: mean length of the flow, px of the analysed frame
    cut: bool  #: a new shot begins
    #: mean squared difference to the motion-compensated frame before, squared 8-bit codes
    change: float = 0.0
    detail: float = 0.0  #: mean squared gradient, squared 8-bit codes
    moving: float = 1.0  #: fraction of the detail that moves
    fast: float = 0.0  #: length of the flow that 1 % of the pixels exceed, px of the analysed frame


@dataclass(frozen=True, slots=True)
class Analysis:
    """What the first pass over the source found."""

    stats: tuple[FrameStats, ...]  #: of every frame
    shown: tuple[int, int]  #: when the first frame appears and the last one ends, ticks

    def to_json(self) -> dict[str, Any]:
        """Return the analysis as JSON can hold it."""
        return asdict(self)

    @classmethod
    def from_json(cls, value: Any) -> Analysis | None:
        """Return an analysis from JSON; None if it has another shape."""
        match value:
            case {"stats": list(stats), "shown": [int(first), int(end)]}:
                with suppress(TypeError):
                    return cls(tuple(FrameStats(**frame) for frame in stats), (first, end))
        return None


def analyse(frames: Iterable[Image], estimate: FlowEstimator) -> Iterator[FrameStats]:
    """Yield the statistics of each frame; the first counts as a cut.

    Args:
        frames: (H, W, 3) uint8, read one at a time.
        estimate: optical flow.
    """
    previous: Image | None = None
    usual: float | None = None  # running mean of the difference between frames of a shot
    for frame in frames:
        small = resize(frame, ANALYSIS.height)
        detail = _detail(small)
        if previous is None:
            yield FrameStats(0.0, True, 0.0, detail)
        else:
            difference = float(cv2.absdiff(previous, small).mean())
            cut = (
                difference > ANALYSIS.cut_difference
                and difference > ANALYSIS.cut_ratio * (usual or 0.0)
                and _histogram_correlation(previous, small) < ANALYSIS.cut_correlation
            )
            if cut:
                yield FrameStats(0.0, True, 0.0, detail)
            else:
                flow = estimate(previous, small)
                change, length = _change(previous, small, flow), lengths(flow)
                motion, fast = float(length.mean()), float(np.percentile(length, 99))
                yield FrameStats(motion, False, change, detail, _moving(small, length), fast)
            usual = None if cut else difference if usual is None else (usual + difference) / 2
        previous = small


def _detail(image: Image) -> float:
    values = image.astype(np.float32)
    gradients = (np.diff(values, axis=axis) for axis in (0, 1))
    return sum(float(np.square(g).mean()) if g.size else 0.0 for g in gradients)


def _moving(image: Image, length: NDArray[np.float32]) -> float:
    detail = gradient(image)
    total = float(detail.sum())
    return float(detail[length > ANALYSIS.moves_px].sum()) / total if total else 0.0


def _change(previous: Image, image: Image, flow: FlowField) -> float:
    y, x = np.indices(flow.shape[:2], np.float32)
    moved = cv2.remap(
        image, x + flow[..., 0], y + flow[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    return float(np.square(moved.astype(np.float32) - previous).mean())


def _histogram_correlation(first: Image, second: Image) -> float:
    histograms = [
        cv2.calcHist([image], [0, 1, 2], None, [8, 8, 8], [0, 256] * 3) for image in (first, second)
    ]
    return float(cv2.compareHist(histograms[0], histograms[1], cv2.HISTCMP_CORREL))
