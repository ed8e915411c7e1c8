"""Hostile files by the thousand: `python -m tests.fuzz --seconds 30`.

Every input goes all the way: container, planes, model, a few rendered pixels. Whatever it holds,
the package's own errors come out, or frames, in little time; a file whose checksums were left alone
never gives another frame than the one that was encoded. `tests/fuzz_guided.py` does the same with
inputs that are chosen by what code they reach.
"""

from __future__ import annotations

import argparse
import io
import random
import signal
import struct
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from types import FrameType

from gsvrcodec.bitstream.chunk import (
    GOP_TYPE,
    HEAD_BYTES,
    OVERHEAD_BYTES,
    SIGNATURE,
    TAIL_BYTES,
    chunk_bytes,
    is_type,
)
from gsvrcodec.bitstream.gop_chain import GopUnpacker
from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.errors import CorruptError, GsvrError
from gsvrcodec.limits import Limits
from gsvrcodec.model.time import normalised_time
from gsvrcodec.render import render_frames
from tests.gops import HEADER, make_chain, make_file, make_payload
from tests.tampering import Piece, edited, joined, pieces, with_plane

#: Longest that one input may take, seconds.
PATIENCE = 2.0
SIZE = (16, 16)
#: Rendering thousands of Gaussians is slow by right; it is no fault.
LIMITS = Limits(gaussians=10_000, gop_frames=64, plane_samples=2**20, expansion_base=2**22)

Frames = dict[int, bytes]


def seeds() -> list[bytes]:
    """Sound files, one for every way to code a plane, and chains of predicted GOPs."""
    chains = [
        make_file(make_chain((2, 1, 2), 30, grid=(3, 2, 2), pack=pack))
        for pack in ("deflate", "entropy")
    ]
    sums = make_file(
        make_chain((2, 1), 20, grid=(3, 2, 2), blending="sum"), replace(HEADER, blending="sum")
    )
    return [*chains, sums] + [
        make_file(
            [
                make_payload(30, grid, frames=2, pack=pack, seed=1),
                make_payload(9, grid, frames=1, first_frame=2, start_pts=80, pack=pack),
            ],
            auxiliary=((b"sett", b'{"seed": 0}'),),
        )
        for pack in ("deflate", "png", "jxl", "entropy", "auto")
        for grid in ((0, 0, 0), (3, 2, 4))
    ]


def decoded(data: bytes) -> Frames:
    """Every frame that can be had, by number; raises what opening the file does."""
    found: Frames = {}
    with GsvrReader(io.BytesIO(data), LIMITS) as reader:
        unpacker = GopUnpacker(reader, LIMITS)
        for position in range(len(reader.gops)):
            try:
                content = unpacker.unpack(position)
            except CorruptError:
                continue
            coded = reader.header.width, reader.header.height
            taus = normalised_time(content.pts)
            blending = reader.header.blending
            frames = render_frames(content.gop, taus, SIZE, coded, threads=1, blending=blending)
            for number, frame in enumerate(frames, content.first_frame):
                found[number] = frame.tobytes()
    return found


def flipped(data: bytes, draw: random.Random) -> bytes:
    """The file with bits flipped, cut, or with a stretch of it doubled, zeroed or gone."""
    changed = bytearray(data)
    for _ in range(draw.choice((1, 1, 1, 2, 8, 64))):
        changed[draw.randrange(len(changed))] ^= 1 << draw.randrange(8)
    start, size = draw.randrange(len(changed)), draw.choice((1, 4, 32, 300))
    match draw.randrange(10):
        case 0:
            del changed[start:]
        case 1:
            del changed[start : start + size]
        case 2:
            changed[start:start] = changed[start : start + size]
        case 3:
            changed[start : start + size] = bytes(len(changed[start : start + size]))
    return bytes(changed)


_INTERESTING = (0, 1, 2, 3, 7, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 2**31 - 1, 2**32 - 1)


def forged(data: bytes, draw: random.Random) -> bytes:
    """The file as an attacker changes it: fields, planes or chunks, with every checksum right."""

    def field(payload: bytearray) -> None:
        layout = draw.choice(("B", "H", "I", "Q"))
        size = struct.calcsize(layout)
        if len(payload) < size:
            return
        # Heads and tables stand at the start.
        top = min(len(payload), draw.choice((60, 400, len(payload)))) - size
        value = draw.choice((*_INTERESTING, draw.getrandbits(64))) % 256**size
        struct.pack_into("<" + layout, payload, draw.randint(0, max(0, top)), value)

    def noise(payload: bytearray) -> None:
        for _ in range(draw.choice((1, 2, 16))):
            payload[draw.randrange(len(payload))] = draw.randrange(256)

    chunks = pieces(data)
    match draw.randrange(5):
        case 0 | 1:
            kind = draw.choice([piece.type for piece in chunks if piece.payload])
            reindex = kind not in (b"indx", b"fend")
            return edited(data, kind, draw.choice((field, noise)), reindex=reindex)
        case 2:
            at = draw.choice([n for n, piece in enumerate(chunks) if piece.type == GOP_TYPE])
            payload = bytearray(chunks[at].payload)
            draw.choice((field, noise))(payload)
            chunks[at] = Piece(GOP_TYPE, bytes(payload))
            return joined(chunks)
        case 3:
            plane = draw.randrange(14)
            at = next(i for i, piece in enumerate(chunks) if piece.type == GOP_TYPE)
            stuff = draw.randbytes(draw.choice((0, 1, 5, 60, 500)))
            fields = {"codec": draw.randrange(7), "bits": 1 + draw.randrange(16)}
            fields |= {"first": draw.randrange(-(2**32), 2**32), "step": draw.randrange(2**16)}
            fields = dict(draw.sample(sorted(fields.items()), draw.randrange(3)))
            chunks[at] = Piece(GOP_TYPE, with_plane(chunks[at].payload, plane, stuff, **fields))
        case _:
            draw.shuffle(chunks)
            chunks = chunks[: draw.randint(1, len(chunks))]
            chunks += draw.sample(chunks, draw.randint(0, 1))
    return joined(chunks, reindex=draw.random() < 0.8)


class TooSlowError(BaseException):
    """An input took longer than `PATIENCE`; no handler of the package can swallow it."""


@contextmanager
def patience() -> Iterator[None]:
    """Interrupt what hangs, as far as Python can."""

    def stop(number: int, frame: FrameType | None) -> None:
        raise TooSlowError

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, 10 * PATIENCE)
    began = time.process_time()
    try:
        yield
        if time.process_time() - began > PATIENCE:
            raise TooSlowError
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def outcome(data: bytes, truth: Frames | None) -> str:
    """Decode one input and say how it ended.

    Args:
        data: the file.
        truth: frames of the file it was made from, None = its checksums were made right.
    """
    try:
        found = decoded(data)
    except GsvrError as error:
        return type(error).__name__
    if truth is not None:
        for number, frame in found.items():
            assert frame == truth[number], f"frame {number} is silently another"
    return "decoded" if truth is None or found.keys() == truth.keys() else "decoded in part"


def run(
    inputs: int, mutate: Callable[[bytes, random.Random], bytes], seed: int, seconds: float = 1e9
) -> Counter[str]:
    """Try so many inputs, or for so many seconds; return how they ended."""
    files = seeds()
    truths = [decoded(data) for data in files]
    ends: Counter[str] = Counter()
    stop = time.monotonic() + seconds
    for number in range(inputs):
        if time.monotonic() > stop:
            break
        draw = random.Random(f"{seed} {number}")
        which = draw.randrange(len(files))
        data = mutate(files[which], draw)
        truth = truths[which] if mutate is flipped else None
        try:
            with patience():
                ends[outcome(data, truth)] += 1
        except BaseException as error:
            error.add_note(f"input {number} of {mutate.__name__}, seed {seed}: {data.hex()}")
            raise
    return ends


def repaired(data: bytes) -> bytes:
    """The file with the checksums of its chunks made right, as far as they can be followed."""
    fixed = bytearray(data)
    offset = len(SIGNATURE)
    while offset + OVERHEAD_BYTES <= len(fixed):
        kind, size = struct.unpack_from("<4sQ", fixed, offset)
        end = offset + OVERHEAD_BYTES + size
        if end > len(fixed) or not is_type(kind):
            break
        payload = bytes(fixed[offset + HEAD_BYTES : end - TAIL_BYTES])
        fixed[offset:end] = chunk_bytes(kind, payload)
        offset = end
    return bytes(fixed)


def main() -> None:
    """Run for a time, or for a number of inputs, and print how they ended."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seconds", type=float, help="how long to try, instead of --inputs")
    parser.add_argument("--inputs", type=int, default=10_000, help="of each kind")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    inputs = options.inputs if options.seconds is None else sys.maxsize
    for mutate in (flipped, forged):
        began = time.monotonic()
        ends = run(inputs, mutate, options.seed, (options.seconds or sys.maxsize) / 2)
        print(f"{mutate.__name__}: {ends.total()} inputs in {time.monotonic() - began:.0f} s")
        for end, count in ends.most_common():
            print(f"  {count:>8} {end}")


if __name__ == "__main__":
    main()
