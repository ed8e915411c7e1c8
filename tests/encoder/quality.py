"""Figures that seeded encodes are held to: `python -m tests.encoder.quality --why "..."`.

Encodes three samples and compares them with tests/encoder/quality.json. With `--why` the figures
are written anew, with the reason why they moved; `test_quality.py` holds encodes to them.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import click

import gsvrcodec
from tests import making
from tests.benchmarks.machine import commit, machine

FIGURES = Path(__file__).with_name("quality.json")

#: dB and part of the bytes by which an encode may differ from the figures: kernels of another
#: instruction set move them by a fraction of that.
PSNR_BOUND, BYTES_BOUND = 0.3, 0.03

#: A number of parameters, a size and a quality to meet: each way that rate control goes.
ENCODES: Mapping[str, tuple[Path, dict[str, Any]]] = {
    "parameters": (making.BUNNY_SMALL, {"frames": 16}),
    "size": (making.NOISE, {"bpp": 0.4, "gop": 10}),
    "quality": (making.ODD, {"target_psnr": 23.0}),
}


@dataclass(frozen=True, slots=True)
class Figures:
    """What one encode came to."""

    psnr: float  #: dB, mean of the frames
    bytes: int  #: of the file


def encoded(name: str, folder: Path) -> Figures:
    """Encode one of `ENCODES` into a folder."""
    source, settings = ENCODES[name]
    result = gsvrcodec.encode(
        source,
        folder / f"{name}.gsvr",
        preset="fastest",
        seed=0,
        workers=1,
        device="cpu",
        audio=False,
        **settings,
    )
    return Figures(round(result.psnr, 3), result.bytes)


def committed() -> dict[str, Figures]:
    """The figures that encodes are held to."""
    return {
        name: Figures(**one) for name, one in json.loads(FIGURES.read_text())["encodes"].items()
    }


@click.command()
@click.option("--why", help="Write the figures, which moved for this reason.")
def main(why: str | None) -> None:
    """Print the figures of this tree beside the committed ones."""
    with tempfile.TemporaryDirectory() as folder:
        found = {name: encoded(name, Path(folder)) for name in ENCODES}
    before = committed() if FIGURES.exists() else {}
    for name, now in found.items():
        was = before.get(name)
        moved = "new" if was is None else f"{now.psnr - was.psnr:+.3f} dB {now.bytes - was.bytes:+}"
        print(f"{name:12}{now.psnr:8.3f} dB{now.bytes:8} bytes   {moved}")
    if why is not None:
        content = {
            "why": why,
            "machine": machine(),
            "commit": commit(),
            "encodes": {name: asdict(one) for name, one in found.items()},
        }
        FIGURES.write_text(json.dumps(content, indent=1) + "\n")


if __name__ == "__main__":
    sys.exit(main())
