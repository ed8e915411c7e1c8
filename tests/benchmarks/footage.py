"""The frames that a .gsvr file was made from, and what came back of them, in memory."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from statistics import fmean
from typing import Self

import av
import numpy as np

import gsvrcodec
from gsvrcodec.metrics import psnr
from gsvrcodec.report.compare import open_part
from gsvrcodec.video import Rgb, VideoInfo, VideoReader
from gsvrcodec.video.elementary import source_frames


@dataclass(frozen=True, slots=True, eq=False)
class Footage:
    """Pictures of a source."""

    info: VideoInfo  #: the source
    pictures: tuple[Rgb, ...]  #: (H, W, 3) uint8 each
    #: the frames as other encoders get them; none = made of the pictures
    samples: tuple[av.VideoFrame, ...] = ()

    @classmethod
    def of(cls, video: VideoReader) -> Self:
        """Read all of a video."""
        pictures = tuple(shot.rgb for shot in video)
        return cls(video.info, pictures, tuple(source_frames(video)))

    @property
    def pixels(self) -> int:
        """Pixels of all pictures."""
        return len(self.pictures) * self.info.width * self.info.height

    def same(self, other: Footage) -> bool:
        """Return whether these are `other`'s pictures, by their number and the first one."""
        return len(self.pictures) == len(other.pictures) and np.array_equal(
            self.pictures[0], other.pictures[0]
        )

    def psnr(self, others: Iterable[Rgb]) -> float:
        """Return the mean of the pictures' PSNR, dB."""
        return fmean(psnr(a, b) for a, b in zip(self.pictures, others, strict=True))


@dataclass(frozen=True, slots=True, eq=False)
class Ours:
    """A .gsvr file."""

    path: Path
    bpp: float  #: of the whole file, copied streams left out
    frames: int  #: to look at, from the first one

    def pictures(self, threads: int = 0) -> Iterator[Rgb]:
        """Yield the decoded pictures; `threads` 0 = all cores."""
        with gsvrcodec.open(self.path, threads=threads) as decoder:
            for frame in islice(decoder, self.frames):
                yield frame.data.astype(np.uint8, copy=False)


def read(source: Path, file: Path, frames: int | None = None) -> tuple[Footage, Ours]:
    """Read what a file was made from, as its settings say.

    Args:
        source: The source video.
        file: The .gsvr file that was encoded from it.
        frames: The first ones only; None = all frames of the file.

    Raises:
        UsageError: Source and file do not fit together.
    """
    with gsvrcodec.open(file) as decoder:
        meta = decoder.metadata
    count = min(frames or meta.frames, meta.frames)
    with open_part(source, replace(meta, frames=count), None, None) as video:
        footage = Footage.of(video)
    if len(footage.pictures) < count:
        raise gsvrcodec.UsageError(
            f"{source} ends after {len(footage.pictures)} of the {count} frames of {file}"
        )
    return footage, Ours(file, meta.bpp, count)
