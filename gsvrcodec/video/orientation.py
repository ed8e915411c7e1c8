"""Orientation of a video: rotation and mirroring, read from a source or applied to pictures."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from typing import Any, cast

import av
import numpy as np

from gsvrcodec.video.colour import Rgb

#: FFmpeg's display matrix: 9 numbers, row by row.
_MATRIX = struct.Struct("=9i")


def orientation(frame: av.VideoFrame) -> tuple[int, bool]:
    """Return the clockwise rotation, 0, 90, 180 or 270, and whether mirroring comes before it."""
    try:
        side = cast(Mapping[str, Any], frame.side_data)["DISPLAYMATRIX"]
    except KeyError:
        return 0, False
    a, b, _, c, d, *_ = _MATRIX.unpack(bytes(side)[: _MATRIX.size])
    mirrored = a * d - b * c < 0
    angle = math.degrees(math.atan2(-b, -a) if mirrored else math.atan2(b, a))
    return round(angle / 90) % 4 * 90, mirrored


def upright(rgb: Rgb, rotation: int, mirrored: bool) -> Rgb:
    """Return a picture mirrored and turned as a player shows it."""
    shown = rgb[:, ::-1] if mirrored else rgb
    return np.rot90(shown, -rotation // 90)
