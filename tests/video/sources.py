"""Small sources of several codecs and pixel formats, written for a test."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import av
import numpy as np
from av.video.reformatter import Interpolation
from numpy.typing import NDArray

from gsvrcodec.video import open_video
from tests import making

_EXACT = Interpolation.AREA | Interpolation.ACCURATE_RND


def save(
    path: Path, pictures: list[NDArray[np.uint8]], codec: str, layout: str, **options: Any
) -> Path:
    """Write pictures of any pixel format at 25 a second."""
    with av.open(str(path), "w") as file:
        stream = file.add_stream(codec, rate=25, options=options.pop("options", {}))
        assert isinstance(stream, av.VideoStream)
        stream.height, stream.width = pictures[0].shape[:2]
        stream.pix_fmt = options.pop("pix_fmt", layout)
        stream.codec_context.flags |= options.pop("flags", 0)
        for number, picture in enumerate(pictures):
            frame = av.VideoFrame.from_ndarray(picture, format=layout)
            # Without these swscale gets chroma of 10 bits wrong at some addresses.
            frame = frame.reformat(format=stream.pix_fmt, interpolation=_EXACT)
            frame.pts = number
            file.mux(stream.encode(frame))
        file.mux(stream.encode(None))
    return path


def h264(path: Path, options: dict[str, str]) -> Path:
    """Write the frames of NOISE by x264 with these options, 25 a second."""
    pictures = [frame.rgb for frame in open_video(making.NOISE)]
    return save(path, pictures, "libx264", "rgb24", pix_fmt="yuv420p", options=options)


def fields(path: Path) -> Path:
    """Write a bar that moves from field to field, as interlaced MPEG-2."""
    pictures = []
    for number in range(6):
        picture = np.zeros((48, 64, 3), np.uint8)
        picture[0::2, 8 * number : 8 * number + 16] = 255
        picture[1::2, 8 * number + 4 : 8 * number + 20] = 255
        pictures.append(picture)
    interlaced = 0x20000000 | 0x40000  # estimate motion and transform by field
    return save(path, pictures, "mpeg2video", "rgb24", pix_fmt="yuv420p", flags=interlaced)
