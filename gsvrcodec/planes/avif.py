"""Whole pictures as AVIF, which libraries code (spec section "Plate")."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.errors import CorruptError

#: `color_range` of a frame of full range.
_FULL_RANGE = 2
#: The pixel format, told to FFmpeg when it opens a plate: else it decodes a picture to find it.
_EXPECTED = {"pixel_format": "yuv444p"}
#: How AV1 is coded: for a small squared error, where libavif's choice is for looks alone. One
#: thread gives other bytes than two, more give the same as two.
_OPTIONS: dict[str, Any] = {
    "subsampling": "4:4:4",
    "range": "full",
    "codec": "aom",
    "autotiling": False,
    "max_threads": 2,
    "advanced": {"tune": "ssim"},
}
#: Its speed, and the quick one: a tenth of the time, for 5 to 15 % more bits.
_SPEED, _QUICK_SPEED = 5, 8


def encode(picture: NDArray[np.uint8], quality: int, *, quick: bool = False) -> bytes:
    """Code a picture; the same bytes whatever the number of cores.

    Args:
        picture: (H, W, 3) RGB.
        quality: 0 to 100, as AVIF encoders have it.
        quick: In a tenth of the time, for more bytes.
    """
    from PIL import Image

    coded, speed = io.BytesIO(), _QUICK_SPEED if quick else _SPEED
    Image.fromarray(picture).save(coded, "AVIF", quality=quality, speed=speed, **_OPTIONS)
    return coded.getvalue()


def decode(data: bytes, size: tuple[int, int] | None) -> NDArray[np.uint8]:
    """Return Y, Cb and Cr of full range, (3, H, W).

    Args:
        data: As coded.
        size: Width and height that the picture has to have; None = any.

    Raises:
        CorruptError: It is no such picture.
    """
    import av
    import av.error

    limit = {} if size is None else {"max_pixels": str(size[0] * size[1])}
    try:
        with av.open(io.BytesIO(data), "r", format="mov", options=_EXPECTED | limit) as file:
            stream = file.streams.video[0]
            codec = stream.codec_context.codec.canonical_name
            if codec != "av1":
                raise CorruptError(f"the plate is coded as {codec}, expected AV1")
            stream.codec_context.options = limit
            frame = next(file.decode(stream))
    except (av.error.FFmpegError, UnicodeDecodeError, IndexError, StopIteration) as error:
        raise CorruptError("the plate is no AVIF picture that can be decoded") from error
    if size not in (None, (frame.width, frame.height)):
        raise CorruptError(f"plate of {frame.width}x{frame.height} pixels, not of the coded size")
    if frame.format.name not in ("yuv444p", "yuvj444p") or frame.color_range != _FULL_RANGE:
        raise CorruptError(f"plate of {frame.format.name}, expected 4:4:4 of full range, 8 bits")
    return np.asarray(frame.to_ndarray(), np.uint8)
