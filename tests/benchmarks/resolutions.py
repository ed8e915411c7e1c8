"""Time and memory by the size of the picture: `python -m tests.benchmarks.resolutions FILM`.

A film is scaled to several heights, encoded by `gsvrenc` and decoded frame after frame, each by
processes of their own. With a key frame a second chains are encoded side by side, as in a long
film. Memory is the most that all processes of a command have at the same time, what they share
counted once (PSS of Linux).
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from fractions import Fraction
from itertools import islice
from pathlib import Path
from typing import Any

import av
import click
import cv2
import numpy as np

from tests.benchmarks.machine import command, commit, machine

#: Seconds between two looks at the memory.
_LOOK = 0.03

#: Prints the seconds that the frames of an opened file take.
_DECODE = """
import sys, time, gsvrcodec
with gsvrcodec.open(sys.argv[1]) as decoder:
    began = time.perf_counter()
    for frame in decoder.frames():
        pass
    print(time.perf_counter() - began)
"""


@dataclass(frozen=True, slots=True)
class Run:
    """What a command took, and what it printed."""

    seconds: float
    megabytes: float
    printed: str


@dataclass(frozen=True, slots=True)
class Row:
    """A film of one size."""

    width: int
    height: int
    frames: int
    psnr: float
    bpp: float
    seconds: float  #: of the encode, a frame
    megabytes: float  #: of the encode
    decoded: float  #: frames a second, of an opened file
    decode_megabytes: float


def run(words: Sequence[str]) -> Run:
    """Run a command to its end."""
    began, most = time.perf_counter(), 0
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        while process.poll() is None:
            most = max(most, sum(map(_kilobytes, _family(process.pid))))
            time.sleep(_LOOK)
        assert process.stdout is not None
        printed = process.stdout.read()
    if process.returncode:
        raise click.ClickException(f"{words[0]} ended with {process.returncode}")
    return Run(time.perf_counter() - began, most / 1024, printed)


def _family(process: int) -> Iterator[int]:
    """Yield a process and all that it has started."""
    yield process
    for thread in Path(f"/proc/{process}/task").glob("*/children"):
        try:
            children = thread.read_text().split()
        except OSError:  # it has ended
            continue
        for child in children:
            yield from _family(int(child))


def _kilobytes(process: int) -> int:
    try:
        lines = Path(f"/proc/{process}/smaps_rollup").read_text().splitlines()
    except OSError:
        return 0
    return next((int(line.split()[1]) for line in lines if line.startswith("Pss:")), 0)


def scaled(film: Path, target: Path, height: int, frames: int) -> tuple[int, int]:
    """Write the first frames of a film in another size, and return it."""
    with av.open(str(film)) as source, av.open(str(target), "w") as written:
        old = source.streams.video[0]
        width = 2 * round(old.width * height / old.height / 2)
        stream = written.add_stream("libx264", rate=Fraction(25))
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        stream.options = {"crf": "12", "preset": "veryfast"}
        for number, frame in enumerate(islice(source.decode(old), frames)):
            picture = frame.to_ndarray(format="rgb24")
            own = cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)
            shot = av.VideoFrame.from_ndarray(np.asarray(own, np.uint8), format="rgb24")
            shot.pts, shot.time_base = number, Fraction(1, 25)
            written.mux(stream.encode(shot))
        written.mux(stream.encode(None))
    return width, height


def measured(film: Path, folder: Path, height: int, frames: int, options: Sequence[str]) -> Row:
    """Measure one size."""
    source, coded, stats = folder / "film.mp4", folder / "film.gsvr", folder / "stats.json"
    width, height = scaled(film, source, height, frames)
    encode = run(["gsvrenc", "-y", "-q", str(source), str(coded), "--stats", str(stats), *options])
    told: dict[str, Any] = json.loads(stats.read_text())
    decode = run([sys.executable, "-c", _DECODE, str(coded)])
    count = told["frames"]
    return Row(
        width,
        height,
        frames=count,
        psnr=told["psnr"],
        bpp=told["bpp"],
        seconds=encode.seconds / count,
        megabytes=encode.megabytes,
        decoded=count / float(decode.printed),
        decode_megabytes=decode.megabytes,
    )


@click.command(context_settings={"ignore_unknown_options": True})
@click.argument("film", type=click.Path(path_type=Path, exists=True, dir_okay=False))
@click.argument("options", nargs=-1, type=click.UNPROCESSED)
@click.option("--heights", default="360,720,1080,2160", show_default=True, help="Pixels.")
@click.option("--frames", default=50, show_default=True, type=click.IntRange(min=1))
@click.option("--json", "output", type=click.Path(path_type=Path), help="Write all of it here.")
def main(
    film: Path, options: tuple[str, ...], heights: str, frames: int, output: Path | None
) -> None:
    """Encode and decode FILM in several sizes; OPTIONS are those of gsvrenc."""
    options = options or ("--keyint", "1")
    print(machine())
    print(f"{film.name}, {' '.join(options)}")
    print(
        f"{'size':>10}{'PSNR':>7}{'bpp':>8}{'s a frame':>11}{'a Mpixel':>10}{'MB':>6}"
        f"{'decode fps':>12}{'MB':>6}"
    )
    rows = []
    for height in map(int, heights.split(",")):
        with tempfile.TemporaryDirectory() as folder:
            row = measured(film, Path(folder), height, frames, options)
        rows.append(row)
        megapixels = row.width * row.height / 1e6
        print(
            f"{f'{row.width}x{row.height}':>10}{row.psnr:7.2f}{row.bpp:8.4f}{row.seconds:11.2f}"
            f"{row.seconds / megapixels:10.2f}{row.megabytes:6.0f}{row.decoded:12.1f}"
            f"{row.decode_megabytes:6.0f}",
            flush=True,
        )
    if output is not None:
        document = {
            "machine": machine(),
            "commit": commit(),
            "load": os.getloadavg()[0],
            "command": command("tests.benchmarks.resolutions"),
            "rows": [asdict(row) for row in rows],
        }
        output.write_text(json.dumps(document, indent=1) + "\n")


if __name__ == "__main__":
    main()
