"""What stands still from GOP to GOP of a shot: found, so that it can be fitted and stored once."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from gsvrcodec.errors import InputError
from gsvrcodec.fit.flow import resize
from gsvrcodec.fit.slicing import ANALYSIS_HEIGHT, Step
from gsvrcodec.model.scene import Scene
from gsvrcodec.video import Rgb, VideoReader

#: Frames of a shot that are looked at, and the most frames that share a scene: light changes.
_SAMPLES, _LONGEST = 11, 400
#: A place stands still if what changes there, in mean square, is less than this share of its
#: variance, or than so many squared codes.
_CHANGE_SHARE, _CHANGE_CODES = 0.25, 20.0
_BOX_PX = 9
#: How much what moves is blurred in the picture of what does not, px.
_BLUR_PX = 8.0
#: Least part of a shot's detail that has to stand still.
_LEAST_SHARE = 0.35


@dataclass(frozen=True, slots=True, eq=False)
class StillShot:
    """A run of GOPs between cuts, much of which stands still."""

    number: int  #: of its scene, from 1
    gops: range  #: positions among the GOPs
    share: float  #: of all detail, that of what stands still
    picture: bytes  #: what stands still, a PNG file; what moves in it is blurred


def still_shots(
    video: VideoReader, gops: Sequence[range], steps: Sequence[Step]
) -> Iterator[StillShot]:
    """Yield the shots of two GOPs or more, much of which stands still.

    Reads the video once, if it has any shot of two GOPs.

    Args:
        video: the source.
        gops: frames of each.
        steps: every frame as `analyse` measured it.

    Raises:
        InputError: the video has become shorter.
    """
    shots = iter(video)
    at, number = 0, 1
    for run in _runs(gops, steps):
        first, end = gops[run.start].start, gops[run.stop - 1].stop
        wanted = np.unique(np.linspace(first, end - 1, _SAMPLES).round().astype(int)).tolist()
        samples = []
        for index in wanted:
            for shot in shots:
                at += 1
                if at > index:
                    samples.append(shot.rgb)
                    break
        if len(samples) < len(wanted):
            raise InputError(f"{video.info.path} became shorter while it was read")
        # A look at small pictures tells most of those apart that move.
        if still_picture([resize(sample, ANALYSIS_HEIGHT) for sample in samples])[1] < _LEAST_SHARE:
            continue
        picture, share = still_picture(samples)
        if share >= _LEAST_SHARE:
            png = cv2.imencode(".png", picture[..., ::-1])[1].tobytes()
            yield StillShot(number, run, share, png)
            number += 1


def _runs(gops: Sequence[range], steps: Sequence[Step]) -> Iterator[range]:
    """Yield runs of two GOPs or more within one shot, long shots in several runs."""
    cuts = [n for n, gop in enumerate(gops) if steps[gop.start].cut or n == 0] + [len(gops)]
    for begin, end in pairwise(cuts):
        frames = gops[end - 1].stop - gops[begin].start
        parts = min(-(-frames // _LONGEST), (end - begin) // 2)
        bounds = np.linspace(begin, end, max(1, parts) + 1).round().astype(int).tolist()
        for first, last in pairwise(bounds):
            if last - first > 1:
                yield range(first, last)


def still_rgb(png: bytes) -> Rgb:
    """Return the picture in a PNG file of a `StillShot`, (H, W, 3)."""
    bgr = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    assert bgr is not None
    return np.ascontiguousarray(bgr[..., ::-1], np.uint8)


def still_picture(samples: Sequence[Rgb]) -> tuple[Rgb, float]:
    """Return the picture of what stands still in frames, and its share of all detail.

    What moves is blurred in it, so that nothing is spent on it.

    Args:
        samples: (H, W, 3) frames of one shot.
    """
    median = np.median(np.stack(samples), axis=0).astype(np.uint8)
    rests = at_rest(median, samples)
    blurred = cv2.GaussianBlur(median, (0, 0), _BLUR_PX)
    picture = np.where(rests[..., None], median, blurred)
    whole = sum(float(_detail(sample).sum()) for sample in samples) / len(samples)
    share = float(_detail(median)[rests].sum()) / max(whole, 1e-9)
    return picture, min(share, 1.0)


def at_rest(picture: Rgb, frames: Sequence[Rgb] | NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Return where frames look like a picture, (H, W)."""
    change = np.zeros(picture.shape[:2], np.float32)
    for frame in frames:
        change += np.square(cv2.absdiff(frame, picture).astype(np.float32)).mean(axis=2)
    values = picture.astype(np.float32)
    variance = (_blurred(np.square(values)) - np.square(_blurred(values))).mean(axis=2)
    allowed = np.maximum(_CHANGE_SHARE * variance, _CHANGE_CODES)
    rests: NDArray[np.bool_] = _blurred(change / np.float32(len(frames))) < allowed
    return rests


def shown_of(scene: Scene, picture: Rgb, frames: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Return which Gaussians of a scene the frames (F, H, W, 3) of a GOP show, (N,)."""
    height, width = picture.shape[:2]
    rests = at_rest(picture, frames)
    x, y = np.floor((scene.gop.position + 1) / 2 * (width, height)).astype(np.intp).T
    shown: NDArray[np.bool_] = rests[np.clip(y, 0, height - 1), np.clip(x, 0, width - 1)]
    return shown


def _blurred(values: NDArray[np.float32]) -> NDArray[np.float32]:
    out: NDArray[np.float32] = np.asarray(cv2.boxFilter(values, -1, (_BOX_PX, _BOX_PX)), np.float32)
    return out


def _detail(frame: Rgb) -> NDArray[np.float32]:
    """Length of the gradient, (H, W), sum of the channels."""
    dx = cv2.Sobel(frame, cv2.CV_32F, 1, 0, ksize=1)
    dy = cv2.Sobel(frame, cv2.CV_32F, 0, 1, ksize=1)
    total: NDArray[np.float32] = (np.abs(dx) + np.abs(dy)).sum(axis=2)
    return total
