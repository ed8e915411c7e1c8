"""Pictures packed without loss while they wait or travel.

JPEG XL at effort 1 takes 3 to 5 ms to pack and 20 ms to unpack a picture of 1280x720 on one core,
at a ratio of 2.6 (a football player), 4.2 (Bunny), 4.8 (a flower) and 5.7 (a macro). FFV1, x264
without loss, QOI, JPEG-LS, PNG and Zstandard of differences take two to twenty times as long to
pack; the last is much smaller where the camera is locked, 8.9, and not elsewhere (`python -m
tests.benchmarks.packing`).
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import imagecodecs
import numpy as np
from numpy.typing import NDArray

#: Few suffice: reading takes as long as packing on one core.
_THREADS = 4

Pictures = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class PackedPictures:
    """Packed pictures of one GOP."""

    frames: list[bytes]  #: a JPEG XL codestream each
    size: tuple[int, int]  #: height and width, pixels

    def __len__(self) -> int:
        """Return how many pictures there are."""
        return len(self.frames)

    def unpacked(self) -> Pictures:
        """Return (F, H, W, 3) RGB, exactly as packed."""
        pictures = np.empty((len(self.frames), *self.size, 3), np.uint8)
        for frame, picture in zip(self.frames, pictures, strict=True):
            imagecodecs.jpegxl_decode(frame, numthreads=1, out=picture)
        return pictures


def packed(pictures: Pictures) -> PackedPictures:
    """Pack pictures, (F, H, W, 3) RGB, side by side."""
    with ThreadPoolExecutor(_THREADS) as pool:
        frames = list(pool.map(_packed, pictures))
    return PackedPictures(frames, (pictures.shape[1], pictures.shape[2]))


def _packed(picture: Pictures) -> bytes:
    return bytes(imagecodecs.jpegxl_encode(picture, lossless=True, effort=1, numthreads=1))
