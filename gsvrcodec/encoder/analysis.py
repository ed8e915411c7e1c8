"""Statistics of each frame: motion, detail, change, cuts (paper, "Dynamic-aware Time Slicing")."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from gsvrcodec.fit.flow import FlowEstimator, FlowField, Image, motion_degree, resize

#: Frames are analysed at this height, so that motion does not depend on resolution.
ANALYSIS_HEIGHT = 180


# A cut changes the picture at once: little of its histogram and hardly any pixel stays.
_CUT_CORRELATION = 0.75


_CUT_DIFFERENCE = 18.0


_CUT_RATIO = 4.0


@dataclass(frozen=True, slots=True)
class FrameStats:
    """From one frame to the next."""

    motion: float  #: mean length of the flow, pixels of the analysed frame
    cut: bool  #: a new shot begins
    #: what is new: mean squared difference to the frame before, moved along the flow
    change: float = 0.0
    detail: float = 0.0  #: mean squared gradient


def analyse(frames: Iterable[Image], estimate: FlowEstimator) -> Iterator[FrameStats]:
    """Measure each frame against the one before; the first counts as a cut.

    Args:
        frames: (H, W, 3) uint8, read one at a time.
        estimate: optical flow.
    """
    previous: Image | None = None
    usual: float | None = None  # running mean of the difference between frames of a shot
    for frame in frames:
        small = resize(frame, ANALYSIS_HEIGHT)
        detail = _detail(small)
        if previous is None:
            yield FrameStats(0.0, True, 0.0, detail)
        else:
            difference = float(cv2.absdiff(previous, small).mean())
            cut = (
                difference > _CUT_DIFFERENCE
                and difference > _CUT_RATIO * (usual or 0.0)
                and _histogram_correlation(previous, small) < _CUT_CORRELATION
            )
            if cut:
                yield FrameStats(0.0, True, 0.0, detail)
            else:
                flow = estimate(previous, small)
                change = _change(previous, small, flow)
                yield FrameStats(motion_degree(flow), False, change, detail)
            usual = None if cut else difference if usual is None else (usual + difference) / 2
        previous = small


def _detail(image: Image) -> float:
    values = image.astype(np.float32)
    gradients = (np.diff(values, axis=axis) for axis in (0, 1))
    return sum(float(np.square(g).mean()) if g.size else 0.0 for g in gradients)


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
