"""Whether a .gsvr file decodes to what was encoded: frames, times and quality."""

from __future__ import annotations

import os
from collections.abc import Mapping
from itertools import zip_longest
from statistics import fmean

import numpy as np

from gsvrcodec.decoder.decoder import open as open_gsvr
from gsvrcodec.errors import CorruptError, VerificationError
from gsvrcodec.metrics import psnr
from gsvrcodec.video import VideoReader

#: dB by which the quality of a GOP may differ from what the encoder measured: backends may round
#: single samples differently.
_TOLERANCE = 0.01


def verify_file(
    path: str | os.PathLike[str], video: VideoReader, quality: Mapping[int, float], threads: int
) -> None:
    """Decode a file from its start to its end, and compare it with its source.

    Args:
        path: the .gsvr file.
        video: its source.
        quality: of each GOP, by its first frame: mean PSNR that the encoder measured, dB.
        threads: to render with; 0 = GSVR_THREADS or all cores.

    Raises:
        VerificationError: it cannot be decoded, a frame is missing or shown at another time, or
            the quality is another.
    """
    measured: dict[int, list[float]] = {}
    try:
        with open_gsvr(path, threads=threads) as decoder:
            for number, (shot, frame) in enumerate(zip_longest(video, decoder)):
                if shot is None or frame is None:
                    raise VerificationError(
                        f"the file and its source differ from frame {number} on"
                    )
                if (shot.pts, shot.duration) != (frame.pts, frame.duration):
                    raise VerificationError(f"frame {number} is shown at another time")
                if number in quality:
                    gop = measured.setdefault(number, [])
                gop.append(psnr(frame.data.astype(np.uint8, copy=False), shot.rgb))
    except CorruptError as error:
        raise VerificationError(f"the file cannot be decoded: {error}") from error
    for first, values in measured.items():
        if not abs(fmean(values) - quality[first]) <= _TOLERANCE:
            raise VerificationError(
                f"frames {first} to {first + len(values) - 1} decode to {fmean(values):.3f} dB, "
                f"they were encoded to {quality[first]:.3f} dB"
            )
