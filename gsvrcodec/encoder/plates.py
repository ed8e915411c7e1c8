"""Plates: one for as many chains as it is good for, and each stored once."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain as joined
from typing import Self

from gsvrcodec.bitstream.gop_head import GopEntry
from gsvrcodec.bitstream.gop_payload import coded_plate, on_plate_of
from gsvrcodec.bitstream.writer import GsvrWriter
from gsvrcodec.encoder.film import Chain
from gsvrcodec.fit.footage import Frames, some_frames
from gsvrcodec.fit.plate import Run, Still, drift, pays, quality_at, stays, still_in
from gsvrcodec.fit.target import Slope, bit_worth
from gsvrcodec.fit.tuned import PLATE, PREDICTION
from gsvrcodec.planes import avif

#: Reads frames by their numbers, (K, H, W, 3) RGB.
Read = Callable[[Sequence[int]], Frames]


def gop_plate(frames: Frames, slope: Slope, frame_seconds: float | None = None) -> bytes | None:
    """Return the coded plate of a key GOP of which most stands still; None where none pays.

    Args:
        frames: (F, H, W, 3) RGB.
        slope: That the GOP aims at.
        frame_seconds: Wall time of a frame; None = as long as it takes.
    """
    seen = _Seen.of([range(len(frames))], slope, lambda numbers: frames[list(numbers)])
    plate = None if seen is None else _Plate.of(seen, lasts=False)
    return None if plate is None else plate.coded(frame_seconds)


@dataclass(frozen=True, slots=True)
class Ground:
    """What stands still in a chain."""

    plate: bytes | None = None  #: coded; None = it has none
    stays: bool = True  #: whether most of what is before the plate stays, too

    def parts(self, chain: Chain) -> list[Chain]:
        """Cut a chain where no GOP would be predicted from the one before."""
        return [chain] if self.stays else [[gop] for gop in chain]


def grounds(
    chains: Sequence[Chain],
    slopes: Sequence[Slope | None],
    read: Read,
    *,
    share: bool,
    frame_seconds: float | None = None,
) -> Iterator[Ground]:
    """Yield what stands still in each chain of a section.

    Chains have the same one as long as it loses less by showing one more than another is worth.
    Frames are read ahead as far as it holds.

    Args:
        chains: Frames of the GOPs of each.
        slopes: That their key GOPs aim at; None = they aim at something else.
        read: Reads frames by their numbers, each later than those before.
        share: Whether chains may have the same plate.
        frame_seconds: Wall time of a frame; None = as long as it takes.
    """

    def look(chain: Chain, slope: Slope | None) -> _Seen | None:
        return None if slope is None else _Seen.of(chain, slope, read)

    seen = joined(map(look, chains, slopes), (None,))
    number, now = 0, next(seen)
    while number < len(chains):
        plate = None if now is None else _Plate.of(now, lasts=True)
        stay = [now is None or plate is None or now.stays]
        number, now = number + 1, next(seen)
        while share and plate is not None and now is not None and plate.takes(now):
            stay.append(now.stays)
            number, now = number + 1, next(seen)
        coded = None if plate is None else plate.coded(frame_seconds)
        del plate  # it is large
        yield from (Ground(coded, one) for one in stay)


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """What stands still in a chain."""

    still: Still
    frames: int  #: of the chain
    shown: float  #: of these, frames in which a place is not hidden, in the mean
    bit: float  #: what a bit has to save, squared 8-bit codes, sum of all frames
    stays: bool  #: whether most of what moves stays from one GOP to the next, as far as it matters

    @classmethod
    def of(cls, chain: Chain, slope: Slope, read: Read) -> Self | None:
        """Look at some frames of a chain; None if it is too short, or the camera moves slowly."""
        frames = range(chain[0].start, chain[-1].stop)
        if len(frames) < PLATE.least_frames:
            return None
        some = some_frames(len(frames), PLATE.frames)
        pictures = read([frames[n] for n in some])
        still = still_in(pictures)
        ends = pictures[0], pictures[-1]
        if still.share >= PLATE.mostly and drift(still, *ends) >= PLATE.drifting_px:
            return None
        shown, bit = slope.lasting * len(chain[0]), bit_worth(slope.qscale)
        several = len(chain) > 1 and still.share >= PLATE.kept
        lasts = not several or stays(pictures[::2], still.picture) >= PREDICTION.kept
        return cls(still, len(frames), shown, bit, lasts)


class _Plate:
    """A plate that pays for one chain, and may hold for more."""

    def __init__(self, seen: _Seen, size: int, seconds: float) -> None:
        self._bit, self._shown, self._frames = seen.bit, seen.shown, seen.frames
        self._seconds = seconds  # that it takes to code it
        self._run = Run.of(seen.still, seen.frames)
        self._cost = 8 * size * seen.bit

    @classmethod
    def of(cls, seen: _Seen, *, lasts: bool) -> Self | None:
        """Return one for a chain, or for a GOP that is not all of its chain; None = none pays.

        Args:
            seen: What stands still.
            lasts: Whether for the whole chain.
        """
        lasts = lasts and seen.frames >= PLATE.lasting_frames
        if seen.still.share < (PLATE.mostly if lasts else PLATE.still):
            return None
        picture = seen.still.picture
        began = time.perf_counter()
        size = len(avif.encode(picture, quality_at(seen.bit / seen.shown), quick=True))
        seconds = PLATE.slower * (time.perf_counter() - began)
        return cls(seen, size, seconds) if pays(seen.still, size, lasts=lasts) else None

    def takes(self, seen: _Seen) -> bool:
        """Let it show the next chain, too, unless another one is better."""
        if seen.still.share < PLATE.kept:
            return False
        most = PLATE.repair * self._cost / seen.still.where.size
        lost, longer = self._run.with_next(seen.still, seen.frames, most)
        if lost >= PLATE.aged * self._cost:
            return False
        self._run, self._shown = longer, self._shown + seen.shown
        self._frames += seen.frames
        return True

    def coded(self, frame_seconds: float | None) -> bytes:
        """Code it as well as it lasts; quickly if it takes much of the wall time of its frames."""
        quality = quality_at(self._bit / self._shown)
        share = 0.0 if frame_seconds is None else self._seconds / (frame_seconds * self._frames)
        return avif.encode(self._run.picture(), quality, quick=share > PLATE.most_time)


class PlatesOnce:
    """Adds GOPs to a file, and each plate once.

    A key GOP with the plate of an earlier one becomes one that is predicted from that, and drops
    its Gaussians.

    Args:
        writer: Of the file.
        share: Whether a GOP may have the plate of another; else all are added as they are.
    """

    def __init__(self, writer: GsvrWriter, *, share: bool) -> None:
        self.writer = writer
        self._share = share
        self._stored: dict[bytes, GopEntry] = {}  # by the digest of their plates

    def add(self, payload: bytes) -> None:
        """Append a GOP; raises as `GsvrWriter.add_gop`."""
        plate = coded_plate(payload) if self._share else None
        digest = b"" if plate is None else hashlib.sha256(plate).digest()
        if digest in self._stored:
            payload = on_plate_of(payload, self._stored[digest])
        entry = self.writer.add_gop(payload)
        if plate is not None:
            self._stored.setdefault(digest, entry)
