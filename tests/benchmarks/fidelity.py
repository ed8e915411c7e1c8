"""What of a video comes back: times, orientation, aspect, colour tags, sound and subtitles.

    python -m tests.benchmarks.fidelity FILE...

Each file is encoded with the least effort, its first 24 frames, decoded to .mp4, and compared with
what it was. A cell is "yes", or what went in and what came out.
"""

from __future__ import annotations

import hashlib
import sys
import tempfile
from fractions import Fraction
from pathlib import Path
from typing import Any

import av

import gsvrcodec
from gsvrcodec.video import VideoReader, open_video
from gsvrcodec.video.probe import demuxed

FRAMES = 24


def facts(video: VideoReader) -> dict[str, Any]:
    """Return what must come back of the pictures."""
    info = video.info
    shown = [(shot.pts * info.time_base, shot.duration * info.time_base) for shot in video]
    return {
        "frames": len(shown),
        "times": [start for start, _ in shown],
        "durations": [duration for _, duration in shown][:-1],  # the last one's may be unknown
        "turned": (info.rotation, info.mirrored),
        "aspect": str(info.sample_aspect),
        "bits": min(info.bit_depth, 10),
        "colour": (info.colour.primaries, info.colour.transfer, info.colour.matrix),
        "range": "full" if info.colour.full_range else "limited",
    }


def streams(path: Path, stop: Fraction | None = None) -> list[tuple[str, str, int]]:
    """Return codec, a hash of times and bytes of the packets, and their number, of each stream."""
    with av.open(str(path)) as container:
        chosen = [s for s in container.streams if s.type in ("audio", "subtitle")]
        found: dict[int, list[bytes]] = {stream.index: [] for stream in chosen}
        for packet in demuxed(container, chosen):
            start = Fraction(packet.pts or 0) * packet.time_base
            if stop is None or start < stop:
                # In whole samples at 48 kHz: what a muxer's own clock cannot change.
                place = round(start * 48000).to_bytes(8, "little", signed=True)
                found[packet.stream.index].append(place + bytes(packet))
        return [
            (
                stream.codec_context.name,
                hashlib.sha256(b"".join(found[stream.index])).hexdigest()[:8],
                len(found[stream.index]),
            )
            for stream in chosen
            if found[stream.index]
        ]


def compare(source: Path, folder: Path) -> dict[str, str]:
    """Encode and decode a file; return the cells of its row."""
    coded, decoded = folder / "a.gsvr", folder / "b.mp4"
    gsvrcodec.encode(source, coded, preset="fastest", frames=FRAMES, overwrite=True)
    gsvrcodec.decode(coded, decoded, overwrite=True)
    video = open_video(source, frames=FRAMES)
    before, after = facts(video), facts(open_video(decoded))
    row = {
        name: "yes" if value == after[name] else f"{value} -> {after[name]}"
        for name, value in before.items()
    }
    last = list(open_video(source, frames=FRAMES))[-1]
    end = (last.pts + last.duration) * video.info.time_base
    kept, written = streams(source, end), streams(decoded)
    row["sound"] = "yes" if kept == written else f"{kept} -> {written}"
    row["sound"] += f" ({len(written)})"
    return row


def main() -> None:
    """Print a table of the files named on the command line."""
    with tempfile.TemporaryDirectory() as folder:
        for number, name in enumerate(sys.argv[1:]):
            try:
                row = compare(Path(name), Path(folder))
            except gsvrcodec.errors.GsvrError as error:
                print(f"| {Path(name).name} | {error} |", flush=True)
                continue
            if not number:
                print(f"| file | {' | '.join(row)} |\n|{'---|' * (1 + len(row))}")
            print(f"| {Path(name).name} | {' | '.join(row.values())} |", flush=True)


if __name__ == "__main__":
    main()
