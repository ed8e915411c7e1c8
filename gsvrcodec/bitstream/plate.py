"""Plates as they are stored: AVIF (spec section "Plate")."""

from __future__ import annotations

import io
import struct

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.errors import CorruptError, spec_section
from gsvrcodec.model.plate import Plate

_LENGTH = struct.Struct("<I")
#: `color_range` of a frame that has full range.
_FULL_RANGE = 2
#: Effort of the AV1 encoder: slower ones take 8 to 20 times as long and save 2 to 4 % at most.
_SPEED = 6


def pack_plate(picture: NDArray[np.uint8], quality: int) -> bytes:
    """Code a picture as a plate.

    Args:
        picture: (H, W, 3) RGB.
        quality: 0 to 100, as AVIF encoders have it.
    """
    import imagecodecs

    coded: bytes = imagecodecs.avif_encode(
        picture, level=quality, speed=_SPEED, pixelformat="444", numthreads=1
    )
    return coded


def plate_bytes(data: bytes | None) -> bytes:
    """Return the part of a GOP's payload that holds a coded plate; None = no plate."""
    return b"" if data is None else _LENGTH.pack(len(data)) + data


@spec_section("5.7")
def find_plate(payload: bytes, offset: int) -> tuple[bytes, int]:
    """Return the coded plate at an offset of a GOP's payload, and the offset behind it.

    Raises:
        CorruptError: The payload ends before it.
    """
    begin = offset + _LENGTH.size
    if begin > len(payload):
        raise CorruptError("the payload ends in its plate")
    end = begin + int(_LENGTH.unpack_from(payload, offset)[0])
    if end > len(payload):
        raise CorruptError(f"plate of {end - begin} bytes where {len(payload) - begin} are left")
    return payload[begin:end], end


@spec_section("5.7")
def unpack_plate(data: bytes, size: tuple[int, int] | None = None) -> Plate:
    """Decode a plate.

    Args:
        data: As coded.
        size: Width and height of the coded frame, pixels; None = whatever the picture has.

    Raises:
        CorruptError: It is not a picture of this size as plates have to be.
    """
    import av
    import av.error

    try:
        with av.open(io.BytesIO(data), format="mov") as file:
            stream = file.streams.video[0]
            if size is not None:
                stream.codec_context.options = {"max_pixels": str(size[0] * size[1])}
            frame = next(file.decode(stream))
    except (av.error.FFmpegError, IndexError, StopIteration) as error:
        raise CorruptError("the plate is no AVIF picture that can be decoded") from error
    if size not in (None, (frame.width, frame.height)):
        raise CorruptError(f"plate of {frame.width}x{frame.height} pixels in a film of others")
    if frame.format.name not in ("yuv444p", "yuvj444p") or frame.color_range != _FULL_RANGE:
        raise CorruptError(f"plate of {frame.format.name}, expected 4:4:4 of full range, 8 bits")
    ycc: NDArray[np.uint8] = frame.to_ndarray()
    return Plate(ycc)
