"""Plates: what stands still, as one picture behind all Gaussians."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations, pairwise
from typing import Self

import cv2
import numpy as np
from numpy.typing import NDArray

from gsvrcodec.fit.footage import Frames, Picture, halved, some_frames
from gsvrcodec.fit.start import density
from gsvrcodec.fit.tuned import PLATE
from gsvrcodec.model.gop import Float32Array


@dataclass(frozen=True, slots=True, eq=False)
class Still:
    """What stands still."""

    picture: Picture  #: (H, W, 3); where it moves, what is there most often
    where: NDArray[np.bool_]  #: (H, W) where it stands still
    share: float  #: of the detail of the picture that does

    def texture(self) -> float:
        """Return how much texture it has: mean difference from its own means, 8-bit codes."""
        there = _texture(self.picture)[self.where]
        return float(there.mean()) if there.size else 0.0


def still_in(pictures: Frames) -> Still:
    """Return what stands still in frames that are spread evenly, (K, H, W, 3)."""
    usual, seen = most_usual(pictures)
    where = seen >= PLATE.usual * len(pictures)
    return Still(usual, where, _share(usual, where))


def shows(frames: Frames, plate: Picture) -> bool:
    """Return whether the frames of a GOP, (F, H, W, 3), show most of a plate, (H, W, 3).

    A plate of few bits has lost texture: a frame shows it where the frame is nearer to the plate
    than to its own means of small boxes.
    """
    own = frames[some_frames(len(frames), PLATE.frames)]
    seen = np.sum([_shown(frame, plate) for frame in own], axis=0)
    return _share(plate, seen >= PLATE.usual * len(own)) >= PLATE.kept


def drift(still: Still, first: Picture, last: Picture) -> float:
    """Return how far what seems to stand still has moved from one picture to another.

    A camera that moves by a pixel or two in a GOP changes smooth things by less than noise does.

    Args:
        still: What seems to stand still.
        first: (H, W, 3).
        last: (H, W, 3).

    Returns:
        Root mean square motion of these places by an affine map, px; 0 where none is found.
    """
    alike = still.where & ~differs(first, still.picture) & ~differs(last, still.picture)
    one, other = (cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY) for picture in (first, last))
    start = np.eye(2, 3, dtype=np.float32)
    how = cv2.MOTION_AFFINE, (cv2.TERM_CRITERIA_COUNT, PLATE.drift_steps, 0.0)
    try:
        _, found = cv2.findTransformECC(one, other, start, *how, _mask(alike), 5)
    except cv2.error:  # they have nothing in common, or nothing to see
        return 0.0
    motion = found - np.eye(2, 3)
    m = cv2.moments(_mask(alike), binaryImage=True)  # sums of x^i y^j over these places
    places = [
        [m["m20"], m["m11"], m["m10"]],
        [m["m11"], m["m02"], m["m01"]],
        [m["m10"], m["m01"], m["m00"]],
    ]
    return math.sqrt(np.trace(motion @ places @ motion.T) / m["m00"])


def stays(pictures: Frames, plate: Picture) -> float:
    """Return the share of what is before a plate that stays from one picture to the next.

    Args:
        pictures: (K, H, W, 3).
        plate: (H, W, 3).
    """
    before = same = PLATE.repairs * (len(pictures) - 1)
    for last, picture in pairwise(pictures):
        other = density(picture[None]) * differs(picture, plate)
        before += float(other.sum())
        same += float((other * ~differs(picture, last)).sum())
    return same / before if before else 1.0


def _share(picture: Picture, where: NDArray[np.bool_]) -> float:
    """Return the share of the detail of a picture that lies in some places, (H, W)."""
    return float((density(picture[None]) * where).sum())


def pays(still: Still, coded: int, *, lasts: bool) -> bool:
    """Return whether a plate is better than Gaussians alone.

    One of which most lasts is, if it shows anything. Else Gaussians take more bits for texture, and
    fewer for what is smooth.

    Args:
        still: What it shows.
        coded: About its bytes.
        lasts: Whether that stands still for a whole chain, not only for a GOP.
    """
    most = still.share >= PLATE.still or still.texture() >= PLATE.textured
    least = PLATE.empty_bits if lasts and most else PLATE.least_bits
    return 8 * coded >= least * still.where.size


def most_usual(pictures: Frames) -> tuple[Picture, NDArray[np.uint8]]:
    """Return what a plate is to show, (H, W, 3), and how many pictures do, (H, W), place by place.

    It is the mean of those pictures, which has less noise than any of them.

    Args:
        pictures: (K, H, W, 3).
    """
    middle, chosen = pictures[0].copy(), _worthiest(halved(pictures))
    chosen = np.asarray(cv2.resize(chosen, middle.shape[1::-1], interpolation=cv2.INTER_NEAREST))
    for number, picture in enumerate(pictures[1:], 1):
        cv2.copyTo(picture, _mask(chosen == number), middle)
    total, count = np.zeros(middle.shape, np.float32), np.zeros(middle.shape[:2], np.uint8)
    for picture in pictures:
        alike_there = _mask(~differs(picture, middle))
        cv2.accumulate(picture, total, alike_there)
        count += alike_there
    total /= np.maximum(count, 1)[..., None]
    usual = np.asarray(cv2.copyTo(cv2.convertScaleAbs(total), _mask(count > 0), middle), np.uint8)
    return usual, count


def _worthiest(pictures: Frames) -> NDArray[np.uint8]:
    """Return which of some pictures, (K, h, w, 3), a plate is best to show, (h, w), place by place.

    It is worth the more the more others show the same, and the more texture it has: Gaussians
    take few bits for what is smooth. Neighbouring places have the same picture where they can: no
    edge comes in that none has.
    """
    alike = np.zeros(pictures.shape[:3], np.uint8)
    for one, other in combinations(range(len(pictures)), 2):
        same = ~differs(pictures[one], pictures[other])
        alike[one] += same
        alike[other] += same
    chosen, most = np.zeros(alike.shape[1:], np.uint8), np.full(alike.shape[1:], -1, np.float32)
    for number, (others, picture) in enumerate(zip(alike, pictures, strict=True)):
        worth = others * (_texture(picture) + np.float32(PLATE.plain))
        worth = cv2.blur(worth, 2 * (PLATE.part_px,))
        chosen[worth > most] = number
        most = np.maximum(most, worth)
    return chosen


def _mask(where: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Return places, (H, W), as OpenCV takes them."""
    return where.view(np.uint8)


def differs(frame: Picture, usual: Picture) -> NDArray[np.bool_]:
    """Return where a frame, (H, W, 3), is not as a picture, but for noise, (H, W)."""
    return _apart(frame, usual) >= PLATE.differing


def _shown(frame: Picture, plate: Picture) -> NDArray[np.bool_]:
    """Return where a frame, (H, W, 3), is as a plate, or nearer to it than to its own means."""
    most = np.maximum(PLATE.differing, PLATE.nearer * _texture(frame))
    return np.asarray(_apart(frame, plate) < most)


def _texture(picture: Picture) -> NDArray[np.uint8]:
    """Mean difference of a picture from its own means in a box, (H, W), 8-bit codes."""
    return _apart(picture, _means(picture))


def _apart(frame: Picture, other: Picture) -> NDArray[np.uint8]:
    """Mean difference in a box, (H, W), of the channel where it is largest, 8-bit codes."""
    red, green, blue = cv2.split(_means(np.asarray(cv2.absdiff(frame, other), np.uint8)))
    return np.asarray(cv2.max(cv2.max(red, green), blue), np.uint8)


def _means(picture: Picture) -> Picture:
    """Means of boxes around each pixel, (H, W, 3)."""
    return np.asarray(cv2.blur(picture, 2 * (PLATE.box_px,)), np.uint8)


def mendable(share: Float32Array, frame: Picture, usual: Picture) -> Float32Array:
    """Return which part of the error of a pixel Gaussians in front of a plate can mend, (H, W).

    Where the frame differs from the plate that is all of it, elsewhere their share: the rest is an
    error of the plate, which is coded as well as it pays.

    Args:
        share: (H, W) of the Gaussians in the weights.
        frame: (H, W, 3) that is wanted.
        usual: (H, W, 3) the plate alone.
    """
    return np.maximum(share, differs(frame, usual))


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """What stands still in several chains, one after another."""

    mean: Float32Array  #: (H, W, 3)
    frames: Float32Array  #: (H, W) that it is the mean of; 0 where nothing has stood still

    @classmethod
    def of(cls, still: Still, frames: int) -> Self:
        """Return a run of one chain of so many frames."""
        return cls(still.picture.astype(np.float32), frames * still.where.astype(np.float32))

    def picture(self) -> Picture:
        """Return the mean, (H, W, 3), in whole codes."""
        return self.mean.round().astype(np.uint8)

    def with_next(self, still: Still, frames: int, most: float) -> tuple[float, Run]:
        """Return what a mean that shows the next chain, too, loses, and the run with that chain.

        Where that shows something else the run stays as it is.

        Args:
            still: What stands still in the chain.
            frames: Of the chain.
            most: What is lost at most in a place: Gaussians in front of it take no more.

        Returns:
            Squared error, mean of the channels, sum of all pixels and frames; and the run.
        """
        same = ~differs(still.picture, self.picture()) | (self.frames == 0)
        more: Float32Array = frames * still.where.astype(np.float32)
        share = more / np.maximum(self.frames + more, 1)
        apart = still.picture - self.mean
        lost = self.frames * share * np.square(apart).mean(axis=2)
        mean = self.mean + (same * share)[..., None] * apart
        return float(np.minimum(lost, most).sum()), Run(mean, self.frames + more * same)


def quality_at(worth: float) -> int:
    """Return the quality of a plate, 0 to 100, at which a bit saves what it has to.

    Args:
        worth: What a bit has to save in each frame, squared 8-bit codes, mean of the channels.
    """
    qualities, saved = PLATE.saves.keys(), np.log(list(PLATE.saves.values()))
    return round(float(np.interp(np.log(worth), saved, list(qualities))))
