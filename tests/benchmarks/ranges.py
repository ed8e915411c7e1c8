"""Bytes that a seek reads: `python -m tests.benchmarks.ranges [--minutes N] [--seeks N]`.

Writes a film of random GOPs of the usual size, opens it as over HTTP ranges, shows one frame, and
compares the bytes and the ranges that were read with those that are needed: header, index, and the
chain of GOPs up to that of the frame. Every frame is asked of a newly opened file.
"""

from __future__ import annotations

import io
import random
from statistics import fmean
from typing import Any

import click
import numpy as np

import gsvrcodec
from gsvrcodec.bitstream.chunk import OVERHEAD_BYTES
from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.bitstream.writer import GsvrWriter
from tests.benchmarks.machine import machine
from tests.gops import HEADER, make_carried, make_modes, make_payload

#: Frames a second, frames of a GOP, GOPs of a chain, Gaussians of a GOP, new ones of it.
RATE, FRAMES, CHAIN, GAUSSIANS, NEW = 25, 15, 6, 5000, 400


class Counted(io.BytesIO):
    """Bytes in memory that count what is read of them."""

    ranges = 0
    taken = 0  #: bytes

    def read(self, size: int | None = -1, /) -> bytes:
        """Read, and count."""
        data = super().read(size)
        self.ranges += 1
        self.taken += len(data)
        return data


@click.command()
@click.option("--minutes", default=10, show_default=True, type=click.IntRange(min=1))
@click.option("--seeks", default=40, show_default=True, type=click.IntRange(min=1))
def main(minutes: int, seeks: int) -> None:
    """Measure seeks in a film of so many minutes."""
    print(machine())
    data = film(minutes * 60 * RATE // FRAMES)
    with GsvrReader(data) as reader:
        frames, gops = reader.frames, len(reader.gops)
        fixed = len(data) - sum(OVERHEAD_BYTES + gop.size for gop in reader.gops)
    print(f"{frames} frames in {gops} GOPs, {len(data):,} bytes, header and index {fixed:,}")
    draw = random.Random(0)
    read, needed, ranges = [], [], []
    for _ in range(seeks):
        file = Counted(data)
        with gsvrcodec.open(file) as decoder:
            frame = draw.randrange(frames)
            decoder.get_frame_at(frame)
        read.append(file.taken)
        ranges.append(file.ranges)
        needed.append(fixed + chain_bytes(data, frame))
    over = max(one / other for one, other in zip(read, needed, strict=True)) - 1
    print(f"{seeks} seeks: {fmean(read):,.0f} bytes in {fmean(ranges):.1f} ranges,")
    print(f"needed {fmean(needed):,.0f}; at most {over:.2%} more than needed")


def film(count: int) -> bytes:
    """A file of so many GOPs."""
    file = io.BytesIO()
    with GsvrWriter(file, HEADER) as writer:
        for number in range(count):
            writer.add_gop(gop(number))
    return file.getvalue()


def gop(number: int) -> bytes:
    """The payload of a GOP: a key GOP, or one that is predicted from the GOP before."""
    place = number % CHAIN
    timing: dict[str, Any] = {
        "frames": FRAMES,
        "first_frame": FRAMES * number,
        "start_pts": 40 * FRAMES * number,
        "pack": "deflate",
        "seed": place,
    }
    if not place:
        return make_payload(GAUSSIANS, **timing)
    modes = make_modes(GAUSSIANS)
    dropped = np.flatnonzero(modes == 4)
    modes[dropped[NEW:]] = 0
    return make_payload(
        min(NEW, len(dropped)), **timing, reference=FRAMES, carried=make_carried(modes)
    )


def chain_bytes(data: bytes, frame: int) -> int:
    """Bytes of the chunks of a frame's GOP and of the GOPs that it is predicted from."""
    with GsvrReader(data) as reader:
        found, position = 0, reader.gop_of_frame(frame)
        while True:
            entry = reader.gops[position]
            found += OVERHEAD_BYTES + entry.size
            if entry.is_key:
                return found
            position = reader.gop_of_frame(entry.reference_frame)


if __name__ == "__main__":
    main()
