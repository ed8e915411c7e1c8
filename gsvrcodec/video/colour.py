"""Colour of the source and of the output: CICP tags, and the way between YCbCr and RGB.

RGB here always means the coded (gamma) domain: transfer and primaries are carried, never applied.
"""

from __future__ import annotations

import av
import numpy as np
from av.video.reformatter import ColorRange, Colorspace, Interpolation
from numpy.typing import NDArray

from gsvrcodec.container.header import ColourInfo

Rgb = NDArray[np.uint8]  #: (H, W, 3) red, green, blue

#: CICP code points (ITU-T H.273) that this module must know by name.
MATRIX_RGB = 0
MATRIX_BT601 = 6

#: swscale's coefficient set for a CICP matrix; all others are converted as BT.601.
_COEFFICIENTS = {
    1: Colorspace.ITU709,
    4: Colorspace.FCC,
    7: Colorspace.SMPTE240M,
    9: Colorspace.BT2020,
    10: Colorspace.BT2020,
}

#: Averages chroma over the pixels it stands for, and rounds instead of cutting off.
_TO_YCBCR = Interpolation.AREA | Interpolation.ACCURATE_RND


def source_colour(frame: av.VideoFrame) -> ColourInfo:
    """Return the tags of a decoded frame, unspecified ones left as they are."""
    rgb = frame.format.is_rgb
    full = rgb or frame.color_range == ColorRange.JPEG or frame.format.name.startswith("yuvj")
    return ColourInfo(
        primaries=int(frame.color_primaries),
        transfer=int(frame.color_trc),
        matrix=MATRIX_RGB if rgb else int(frame.colorspace),
        full_range=full,
        chroma_location=0,
    )


def to_rgb(frame: av.VideoFrame) -> Rgb:
    """Return the picture as 8-bit RGB, as every user of swscale sees it.

    A tagged matrix and range are honoured; without tags it is BT.601, limited range. The default
    conversion is kept on purpose: published figures for the usual clips were measured on it.
    """
    rgb: Rgb = frame.to_ndarray(format="rgb24").astype(np.uint8, copy=False)
    return rgb


def output_matrix(colour: ColourInfo) -> int:
    """Return the CICP matrix that YCbCr output is converted with and tagged as.

    Sources without a tag, and RGB, become BT.601: the rule they were read by, now written down.
    """
    return colour.matrix if colour.matrix in _COEFFICIENTS or colour.matrix == 5 else MATRIX_BT601


def ycbcr_format(width: int, height: int) -> str:
    """Return the pixel format for YCbCr output: 4:2:0, or 4:4:4 where a side is odd."""
    return "yuv444p" if width % 2 or height % 2 else "yuv420p"


def to_ycbcr(rgb: Rgb, pixel_format: str, colour: ColourInfo) -> av.VideoFrame:
    """Return an RGB picture as a tagged YCbCr frame of `pixel_format`."""
    matrix = output_matrix(colour)
    frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(rgb), format="rgb24").reformat(
        format=pixel_format,
        dst_colorspace=_COEFFICIENTS.get(matrix, Colorspace.ITU601),
        src_color_range=ColorRange.JPEG,
        dst_color_range=ColorRange.JPEG if colour.full_range else ColorRange.MPEG,
        interpolation=_TO_YCBCR,
    )
    frame.colorspace = matrix
    frame.color_primaries = colour.primaries
    frame.color_trc = colour.transfer
    return frame
