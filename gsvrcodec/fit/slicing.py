"""Cutting a video into GOPs by its motion (paper, "Dynamic-aware Time Slicing")."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from gsvrcodec.fit.flow import FlowEstimator, FlowField, Image, motion_degree, resize

#: Frames are analysed at this height, so that motion does not depend on resolution.
ANALYSIS_HEIGHT = 180
#: Accumulated motion degree at which a GOP ends, pixels of the analysed frame.
MOTION_THRESHOLD = 24.0

# A cut changes the picture at once: little of its histogram and hardly any pixel stays.
_CUT_CORRELATION = 0.75
_CUT_DIFFERENCE = 18.0
_CUT_RATIO = 4.0


@dataclass(frozen=True, slots=True)
class Step:
    """From one frame to the next."""

    motion: float  #: mean length of the flow, pixels of the analysed frame
    cut: bool  #: a new scene begins
    #: what is new: mean squared difference to the frame before, moved along the flow
    change: float = 0.0
    detail: float = 0.0  #: mean squared gradient


def analyse(frames: Iterable[Image], estimate: FlowEstimator) -> Iterator[Step]:
    """Measure each frame against the one before; the first counts as a cut.

    Args:
        frames: (H, W, 3) uint8, read one at a time.
        estimate: optical flow.
    """
    previous: Image | None = None
    usual: float | None = None  # running mean of the difference between frames of a scene
    for frame in frames:
        small = resize(frame, ANALYSIS_HEIGHT)
        detail = _detail(small)
        if previous is None:
            yield Step(0.0, True, 0.0, detail)
        else:
            difference = float(cv2.absdiff(previous, small).mean())
            cut = (
                difference > _CUT_DIFFERENCE
                and difference > _CUT_RATIO * (usual or 0.0)
                and _histogram_correlation(previous, small) < _CUT_CORRELATION
            )
            if cut:
                yield Step(0.0, True, 0.0, detail)
            else:
                flow = estimate(previous, small)
                change = _change(previous, small, flow)
                yield Step(motion_degree(flow), False, change, detail)
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


def slice_gops(
    steps: Iterable[Step],
    gop: int | Literal["adaptive"],
    *,
    minimum: int,
    maximum: int,
    threshold: float = MOTION_THRESHOLD,
) -> list[range]:
    """Frames of each GOP; none spans a cut.

    A fixed `gop` ends after so many frames. For an adaptive one each frame adds its motion over
    `threshold` and 1 / `maximum`; a scene is cut into as few GOPs as keep that sum within 1, all
    of about the same sum, and none of fewer than `minimum` frames unless the scene is.
    """
    scenes: list[list[float]] = []
    for step in steps:
        if step.cut or not scenes:
            scenes.append([])
        scenes[-1].append(step.motion)
    out: list[range] = []
    for scene in scenes:
        if gop == "adaptive":
            lengths = _adaptive_lengths(scene, minimum, maximum, threshold)
        else:
            lengths = [min(gop, len(scene) - at) for at in range(0, len(scene), gop)]
        for length in lengths:
            start = out[-1].stop if out else 0
            out.append(range(start, start + length))
    return out


def _adaptive_lengths(
    motion: list[float], minimum: int, maximum: int, threshold: float
) -> list[int]:
    frames = len(motion)
    total = np.cumsum(motion) / threshold + np.arange(1, frames + 1) / maximum
    parts = max(1, min(math.ceil(total[-1] - 1e-9), frames // minimum))
    lengths: list[int] = []
    for left in range(parts, 1, -1):
        start = sum(lengths)
        done = total[start - 1] if start else 0.0
        goal = done + (total[-1] - done) / left
        length = int(np.searchsorted(total, goal)) + 1 - start
        # The GOPs after this one need their minimum, and can take no more than their maximum.
        most = min(frames - start - (left - 1) * minimum, maximum)
        least = max(frames - start - (left - 1) * maximum, minimum)
        lengths.append(min(max(length, least), most))
    # No number of GOPs may keep both bounds; then the maximum is kept.
    rest = frames - sum(lengths)
    while rest > maximum:
        lengths.append(maximum)
        rest -= maximum
    return [*lengths, rest]
