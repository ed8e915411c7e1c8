"""Colour of source and output: CICP tags, and conversion between YCbCr and RGB.

RGB is always in the transfer domain of the source: transfer and primaries are tags, not applied.
"""

from __future__ import annotations

import av
import numpy as np
from av.video.reformatter import ColorRange, Colorspace, Interpolation
from numpy.typing import NDArray

from gsvrcodec.bitstream.header import ColourInfo

Rgb = NDArray[np.uint8]  #: (H, W, 3) red, green, blue
#: (H, W, 3) red, green, blue: uint8, or uint16 with 10 bits (0 to 1023).
AnyRgb = NDArray[np.uint8 | np.uint16]

#: CICP matrix coefficients (ITU-T H.273).
MATRIX_RGB = 0
MATRIX_BT601 = 6

#: CICP matrices that swscale converts correctly; 2, not specified, is converted as BT.601.
KNOWN_MATRICES = frozenset({0, 1, 2, 4, 5, 6, 7, 9})

#: swscale's coefficients for a CICP matrix; other matrices are converted as BT.601.
_COEFFICIENTS = {
    1: Colorspace.ITU709,
    4: Colorspace.FCC,
    7: Colorspace.SMPTE240M,
    9: Colorspace.BT2020,
    10: Colorspace.BT2020,
}

#: Luma weights of red and blue by CICP matrix; other matrices have those of BT.601.
_LUMA = {
    1: (0.2126, 0.0722),
    4: (0.30, 0.11),
    7: (0.212, 0.087),
    9: (0.2627, 0.0593),
    10: (0.2627, 0.0593),
}
_LUMA_BT601 = (0.299, 0.114)

#: Chroma is the mean over its pixels; samples are rounded, not truncated.
_TO_YCBCR = Interpolation.AREA | Interpolation.ACCURATE_RND


def source_colour(frame: av.VideoFrame) -> ColourInfo:
    """Return the colour tags of a decoded frame; unspecified tags stay unspecified."""
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
    """Return the picture as 8-bit RGB, by swscale's default conversion.

    The tagged matrix and range are used; an untagged source is taken for BT.601, limited range.
    The default conversion is kept because published figures of the usual clips were measured with
    it. A matrix that swscale does not know is replaced: 10 by BT.2020, others by BT.601.
    """
    if frame.colorspace not in KNOWN_MATRICES:
        frame.colorspace = 9 if frame.colorspace == 10 else MATRIX_BT601
    rgb: Rgb = frame.to_ndarray(format="rgb24").astype(np.uint8, copy=False)
    return rgb


def output_matrix(colour: ColourInfo) -> int:
    """Return the CICP matrix that tags YCbCr output: the source's, or BT.601 for an RGB source.

    The output is converted with the coefficients that the source was read with, so the YCbCr of the
    source comes back: BT.601 for an untagged or unknown matrix.
    """
    return MATRIX_BT601 if colour.matrix == MATRIX_RGB else colour.matrix


def ycbcr_format(width: int, height: int, bit_depth: int = 8) -> str:
    """Return the pixel format for YCbCr output: 4:2:0, or 4:4:4 if a side is odd."""
    name = "yuv444p" if width % 2 or height % 2 else "yuv420p"
    return name if bit_depth == 8 else f"{name}{bit_depth}le"


def to_ycbcr(rgb: AnyRgb, pixel_format: str, colour: ColourInfo) -> av.VideoFrame:
    """Return a picture as a tagged YCbCr frame; `pixel_format` must have the bits of `rgb`."""
    if rgb.dtype == np.uint8:
        frame = _to_8_bit(rgb.astype(np.uint8, copy=False), pixel_format, colour)
    else:
        frame = _to_10_bit(rgb.astype(np.uint16, copy=False), pixel_format, colour)
    frame.colorspace = output_matrix(colour)
    frame.color_primaries = colour.primaries
    frame.color_trc = colour.transfer
    return frame


def _to_8_bit(rgb: Rgb, pixel_format: str, colour: ColourInfo) -> av.VideoFrame:
    """Convert with swscale, which is fast and exact for 8 bits."""
    return av.VideoFrame.from_ndarray(np.ascontiguousarray(rgb), format="rgb24").reformat(
        format=pixel_format,
        dst_colorspace=_COEFFICIENTS.get(colour.matrix, Colorspace.ITU601),
        src_color_range=ColorRange.JPEG,
        dst_color_range=ColorRange.JPEG if colour.full_range else ColorRange.MPEG,
        interpolation=_TO_YCBCR,
    )


def _to_10_bit(rgb: NDArray[np.uint16], pixel_format: str, colour: ColourInfo) -> av.VideoFrame:
    """Convert by the definition of H.273: swscale is off by up to three code values of 10 bits."""
    height, width = rgb.shape[:2]
    red, blue = _LUMA.get(colour.matrix, _LUMA_BT601)
    luma = np.array([red, 1 - red - blue, blue])
    cb = (np.array([0, 0, 1]) - luma) / (2 - 2 * blue)
    cr = (np.array([1, 0, 0]) - luma) / (2 - 2 * red)
    black, white, swing = (0, 1023, 1023) if colour.full_range else (64, 940, 896)
    gain = np.array([luma * (white - black), cb * swing, cr * swing]) / 1023
    planes: NDArray[np.float32] = gain.astype(np.float32) @ rgb.reshape(-1, 3).T.astype(np.float32)
    planes += np.array([[black], [512], [512]], np.float32)
    frame = av.VideoFrame(width, height, pixel_format)
    for plane, values in zip(frame.planes, planes.reshape(3, height, width), strict=True):
        if plane.height < height:
            rows = values[::2] + values[1::2]
            values = (rows[:, ::2] + rows[:, 1::2]) * np.float32(0.25)
        padded = np.zeros((plane.height, plane.line_size // 2), "<u2")
        padded[:, : plane.width] = np.rint(values).clip(0, 1023)
        plane.update(padded.tobytes())
    frame.color_range = ColorRange.JPEG if colour.full_range else ColorRange.MPEG
    return frame
