"""Figures that seeded encodes are held to: `python -m tests.encoder.quality --why "..."`.

Encodes samples with a few seeds and compares the means with tests/encoder/quality.json. With
`--why` the figures are written anew, with the reason why they moved; `test_quality.py` holds
encodes to them.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import fmean
from typing import Any

import click

import gsvrcodec
from gsvrcodec.native import _core
from tests import making
from tests.benchmarks.machine import commit, machine

FIGURES = Path(__file__).with_name("quality.json")

#: dB by which the mean of an encode's seeds may differ from the figures.
PSNR_BOUND = 0.3
#: Part of the bytes by which it may. Kernels of another instruction set round otherwise, which
#: changes as much as another seed does: the bytes of one encode by 1.5 % (standard deviation), by
#: 5 % where a quality is to be met.
BYTES_BOUND: Mapping[str, float] = {"parameters": 0.03, "size": 0.03, "quality": 0.1, "crf": 0.03}
SEEDS = (0, 1, 2)
#: Instruction set of the kernels, which most machines have: another gave 3 % other bytes.
ISA = "avx2"

#: Each way that rate control goes.
ENCODES: Mapping[str, tuple[Path, dict[str, Any]]] = {
    "parameters": (making.BUNNY_SMALL, {"frames": 16, "params": 25_568}),
    "size": (making.NOISE, {"bpp": 0.4, "gop": 10}),
    "quality": (making.ODD, {"target_psnr": 23.0}),
    "crf": (making.ODD, {"crf": 26}),
}


@dataclass(frozen=True, slots=True)
class Figures:
    """What encodes with several seeds came to, on average."""

    psnr: float  #: dB, mean of the frames
    bytes: int  #: of the file


def encoded(name: str, folder: Path) -> Figures:
    """Encode one of `ENCODES` into a folder, with the kernels that the figures are of."""
    source, settings = ENCODES[name]
    before = _core.isa()
    _core.use_isa(ISA if ISA in _core.isas() else before)
    results = [
        gsvrcodec.encode(
            source,
            folder / f"{name}-{seed}.gsvr",
            preset="fastest",
            seed=seed,
            workers=1,
            device="cpu",
            audio=False,
            **settings,
        )
        for seed in SEEDS
    ]
    _core.use_isa(before)
    psnr, size = fmean(one.psnr for one in results), fmean(one.bytes for one in results)
    return Figures(round(psnr, 3), round(size))


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
