"""Optical flow between frames, for slicing and for the motion that a fit starts from."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from gsvrcodec.errors import UsageError
from gsvrcodec.fit.options import Flow

Image = NDArray[np.uint8]
FlowField = NDArray[np.float32]
#: From a frame and the next, both (H, W, 3) uint8, to displacement in pixels (H, W, 2).
FlowEstimator = Callable[[Image, Image], FlowField]


def resize(image: Image, height: int) -> Image:
    """Shrink to at most `height` rows, keeping the aspect; never enlarge."""
    rows, columns = image.shape[:2]
    if rows <= height:
        return image
    width = max(1, round(columns * height / rows))
    return np.asarray(cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA), np.uint8)


def flow_estimator(kind: Flow) -> FlowEstimator:
    """Make an estimator: "dis" is OpenCV's, "raft" needs torchvision.

    Raises:
        UsageError: torchvision is not installed.
    """
    return _raft() if kind == "raft" else _dis()


# DIS needs a few of its patches across the frame; smaller frames count as still.
_DIS_MIN_SIDE = 32


def _dis() -> FlowEstimator:
    estimator = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_FAST)

    def estimate(first: Image, second: Image) -> FlowField:
        if min(first.shape[:2]) < _DIS_MIN_SIDE:
            return np.zeros((*first.shape[:2], 2), np.float32)
        grey = [cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in (first, second)]
        initial = np.zeros((*first.shape[:2], 2), np.float32)
        return np.asarray(estimator.calc(grey[0], grey[1], initial), np.float32)

    return estimate


def _raft() -> FlowEstimator:
    try:
        from torchvision.models.optical_flow import Raft_Small_Weights, raft_small
    except ImportError as error:
        raise UsageError(
            "`flow='raft'` needs torchvision, which is not installed: install it, "
            "or use `flow='dis'`"
        ) from error
    import torch

    weights = Raft_Small_Weights.DEFAULT
    model = raft_small(weights=weights).eval()

    def estimate(first: Image, second: Image) -> FlowField:
        height, width = first.shape[:2]
        # RAFT works on multiples of 8, of at least 128 pixels.
        padded = [max(128, (side + 7) // 8 * 8) for side in (height, width)]
        batch = [
            torch.from_numpy(
                np.pad(
                    image,
                    ((0, padded[0] - height), (0, padded[1] - width), (0, 0)),
                    mode="edge",
                ).transpose(2, 0, 1)[None]
            )
            for image in (first, second)
        ]
        with torch.inference_mode():
            flow = model(*weights.transforms()(*batch))[-1][0]
        return np.asarray(flow[:, :height, :width].permute(1, 2, 0).contiguous(), np.float32)

    return estimate


def lengths(flow: FlowField) -> NDArray[np.float32]:
    """Length of each displacement, (H, W) pixels; the mean is the paper's "motion degree"."""
    return np.hypot(flow[..., 0], flow[..., 1])
