"""Timestamps and durations of a GOP, run-length coded (spec section "Timing")."""

from __future__ import annotations

import numpy as np

from gsvrcodec.bitstream.varint import put_varint, take_varint
from gsvrcodec.errors import CorruptError, spec_section
from gsvrcodec.model.time import Ticks


def pack_timing(pts: Ticks, durations: Ticks) -> bytes:
    """Code the timing of a GOP as runs of (frames, step to the next timestamp, duration).

    Args:
        pts: Shape (F,), strictly increasing, ticks.
        durations: Shape (F,), at least 0, ticks.

    Raises:
        ValueError: The timestamps do not increase, or a duration is negative.
    """
    steps = np.diff(pts)
    if (steps <= 0).any() or (durations < 0).any():
        raise ValueError("timestamps must increase and durations must not be negative")
    # The step of the last frame has no meaning: repeat the one before, to extend its run.
    last = steps[-1:] if len(steps) else np.maximum(durations[-1:], 1)
    pairs = np.stack([np.append(steps, last), durations], axis=1)
    starts = np.flatnonzero(np.append(True, (pairs[1:] != pairs[:-1]).any(axis=1)))
    counts = np.diff(np.append(starts, len(pts)))
    out = bytearray()
    for count, (step, duration) in zip(counts, pairs[starts], strict=True):
        for number in (count, step, duration):
            put_varint(out, int(number))
    return bytes(out)


@spec_section("5.2")
def unpack_timing(
    data: bytes, offset: int, start_pts: int, frames: int
) -> tuple[Ticks, Ticks, int]:
    """Parse runs from byte `offset` until they cover `frames` frames.

    Returns:
        Timestamps and durations, shape (frames,) each, and the byte offset after the last run.

    Raises:
        CorruptError: A run is empty, too long, cut short, or has step 0; a timestamp overflows.
    """
    counts: list[int] = []
    steps: list[int] = []
    durations: list[int] = []
    left = frames
    while left:
        count, offset = take_varint(data, offset)
        step, offset = take_varint(data, offset)
        duration, offset = take_varint(data, offset)
        if not 1 <= count <= left:
            raise CorruptError(f"timing run of {count} frames where {left} are left")
        if not 1 <= step < 1 << 62 or duration >= 1 << 62:
            raise CorruptError(f"timing run with step {step} and duration {duration}")
        left -= count
        counts.append(count)
        steps.append(step)
        durations.append(duration)
    if start_pts + sum(c * s for c, s in zip(counts, steps, strict=True)) >= 1 << 63:
        raise CorruptError("timestamps overflow")
    all_steps = np.repeat(np.array(steps, np.int64), counts)
    pts = np.cumsum(np.concatenate([[np.int64(start_pts)], all_steps[:-1]]), dtype=np.int64)
    return pts, np.repeat(np.array(durations, np.int64), counts), offset
