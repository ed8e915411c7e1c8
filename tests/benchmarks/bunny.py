"""The publication's tables for this codec: `python -m tests.benchmarks.bunny [TABLE ...]`.

Encodes the benchmark clip (132 frames, cropped to 1280x640, at most 3M parameters), decodes the
file and measures it against the source. Prints a line as soon as it is known; `--json` keeps all.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import click

import gsvrcodec
from gsvrcodec.report.compare import report
from tests.benchmarks.machine import machine

SOURCE = Path(__file__).parents[2] / "samples" / "bigbuckbunny.mp4"
COMMON: Mapping[str, Any] = {"params": 3_000_000, "crop": (1280, 640, None, None)}

#: Settings of each row, by table. The publication's times are seconds a frame on an RTX A6000.
TABLES: Mapping[str, list[dict[str, Any]]] = {
    "time": [{"time_budget": seconds} for seconds in (0.5, 1.0, 1.5, 2.0)],
    "slow": [{"time_budget": 8.0}],
    "deform": [
        {"time_budget": 1.0, "deform": deform} for deform in ("hybrid", "triplane", "polynomial")
    ],
    "gop": [{"preset": "fast", "gop": gop, "gop_max": 32} for gop in (15, 30, 60, 100, "adaptive")],
    "profile": [
        {"time_budget": 1.0, "profile": profile, "gop": 24} for profile in ("main", "paper")
    ],
    "quantisation": [{"time_budget": 1.0, "qat": qat} for qat in (True, False)],
}


@dataclass(frozen=True, slots=True)
class Row:
    """One encode, measured from its file."""

    table: str
    settings: dict[str, Any]
    psnr: float  #: dB, mean of the frames
    psnr_min: float  #: dB, worst frame
    float_psnr: float  #: dB, mean of the frames before quantisation
    bpp: float
    gops: int
    gaussians: int
    seconds_per_frame: float  #: wall time of the whole encode


def measure(table: str, settings: dict[str, Any], folder: Path) -> Row:
    """Encode the clip with `settings` and compare the file with the source."""
    path = folder / "out.gsvr"
    start = time.perf_counter()
    result = gsvrcodec.encode(SOURCE, path, overwrite=True, **COMMON, **settings)
    seconds = time.perf_counter() - start
    quality = report(SOURCE, path)
    return Row(
        table=table,
        settings=settings,
        psnr=quality.psnr_rgb,
        psnr_min=quality.psnr_rgb_min,
        float_psnr=result.float_psnr,
        bpp=quality.bpp,
        gops=result.gops,
        gaussians=result.gaussians,
        seconds_per_frame=seconds / result.frames,
    )


@click.command()
@click.argument("tables", nargs=-1, type=click.Choice(list(TABLES)))
@click.option("--json", "output", type=click.Path(path_type=Path), help="Write the rows here.")
def main(tables: tuple[str, ...], output: Path | None) -> None:
    """Measure TABLES, or all but "slow", which takes a quarter of an hour."""
    described = machine()
    print(described)
    print(f"{'':36}{'PSNR':>7}{'worst':>7}{'float':>7}{'bpp':>8}{'GOPs':>6}{'s/frame':>9}")
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for table in tables or [name for name in TABLES if name != "slow"]:
            for settings in TABLES[table]:
                row = measure(table, settings, Path(folder))
                rows.append(row)
                name = ", ".join(f"{key} {value}" for key, value in settings.items())
                print(
                    f"{name:36}{row.psnr:7.2f}{row.psnr_min:7.2f}{row.float_psnr:7.2f}"
                    f"{row.bpp:8.4f}{row.gops:6d}{row.seconds_per_frame:9.2f}",
                    flush=True,
                )
    if output is not None:
        document = {"machine": described, "common": COMMON, "rows": [asdict(r) for r in rows]}
        output.write_text(json.dumps(document, indent=1) + "\n")


if __name__ == "__main__":
    sys.exit(main())
