"""The tables of Bunny for any clips: `python -m tests.benchmarks.clips CLIP... [--table NAME]`.

Prints a line as soon as it is known; `--json` keeps all, without the directories of the clips. The
table "equal-bits" takes the first 96 frames at constant qualities, and compares at equal bits.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from math import isfinite
from pathlib import Path
from statistics import fmean, median
from typing import Any

import click

from gsvrcodec.errors import GsvrError
from gsvrcodec.report.reference import parse_reference
from gsvrcodec.report.study import Study, study
from gsvrcodec.video import open_video
from tests.benchmarks import bunny, equal_bits
from tests.benchmarks.encodes import HEADING, Row, document, measure, save, show
from tests.benchmarks.machine import machine

#: Numbers to store for a frame of 1280x640, as the publication has it for Bunny.
PARAMS = 23_000

#: Settings of each row, by table; each at so many parameters, unless it says otherwise.
TABLES: Mapping[str, list[dict[str, Any]]] = {
    "quality": [{"time_budget": 2.0}],
    "gop": [
        {"preset": "fastest", "gop": gop, "gop_max": 100} for gop in (15, 30, 60, 100, "adaptive")
    ],
    "seeds": [{"preset": "fastest", "seed": seed} for seed in range(5)],
    "profile": [
        {"time_budget": 1.0, "profile": profile, "gop": 24} for profile in ("main", "paper")
    ],
    "recipe": [{"preset": "fastest", "bpp": 0.1}],
    "rate": [{"time_budget": 2.0, "bpp": bpp} for bpp in (0.04, 0.1, 0.25, 0.5)],
}
#: The table whose settings depend on the clip.
EQUAL_BITS = "equal-bits"
#: What tables are compared with.
AGAINST: Mapping[str, tuple[str, ...]] = {
    "rate": ("x264:key=12", "x264:intra", "x265", "svtav1"),
    EQUAL_BITS: equal_bits.AGAINST,
}

#: A GOP so much below the other seeds' has diverged, dB.
_FALL = 3.0


@click.command()
@click.argument("clips", nargs=-1, required=True, type=click.Path(path_type=Path, exists=True))
@click.option("--table", "tables", multiple=True, type=click.Choice([*TABLES, EQUAL_BITS]))
@click.option("--frames", type=click.IntRange(min=2), help="The first ones of each only.")
@click.option("--preset", help="Instead of all times, to try it out.")
@click.option("--set", "more", multiple=True, help="NAME=VALUE of all encodes, the value as JSON.")
@click.option("--against", help="Other encoders, as of gsvrreport, instead of the table's own.")
@click.option("--keep", type=click.Path(path_type=Path), help="Directory for the .gsvr files.")
@click.option("--json", "output", type=click.Path(path_type=Path), help="Write the rows here.")
def main(
    clips: tuple[Path, ...],
    tables: tuple[str, ...],
    frames: int | None,
    preset: str | None,
    more: tuple[str, ...],
    against: str | None,
    keep: Path | None,
    output: Path | None,
) -> None:
    """Measure CLIPS by the tables named, or by all of them."""
    added = dict(map(setting, more))
    print(machine())
    print(HEADING)
    rows: list[Row] = []
    refused: list[str] = []
    studies: dict[str, Study] = {}
    with tempfile.TemporaryDirectory() as temporary:
        folder = keep or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        for table in tables or (*TABLES, EQUAL_BITS):
            for clip in clips:
                files = []
                for number, settings in enumerate(_table(table, clip)):
                    path = folder / f"{table}-{clip.stem}-{number}.gsvr"
                    count = frames or (equal_bits.FRAMES if table == EQUAL_BITS else None)
                    common, chosen = _settings(clip, count, settings, preset)
                    common |= added
                    try:
                        row = measure(table, clip, path, chosen, common)
                    except GsvrError as error:
                        refused.append(f"{clip.name}, {chosen}: {error}")
                        print(refused[-1], flush=True)
                        continue
                    rows.append(row)
                    files.append(path)
                    show(row, _name(row))
                    if output is not None:
                        save(output, _document(added, rows, refused, studies))
                if table in AGAINST and files:
                    names = against.split(",") if against else AGAINST[table]
                    references = [parse_reference(name) for name in names]
                    found = study(clip, files, references)
                    studies[clip.name if table == "rate" else f"{clip.name}, {table}"] = found
                    print(*_bd_lines(found), sep="\n", flush=True)
                    print(*equal_bits.lines(equal_bits.figures(found)), sep="\n", flush=True)
                if output is not None:
                    save(output, _document(added, rows, refused, studies))
    print(*summary(rows), sep="\n")


def setting(text: str) -> tuple[str, Any]:
    """Parse NAME=VALUE; a value that is no JSON is taken as text."""
    name, _, value = text.partition("=")
    try:
        return name, json.loads(value)
    except json.JSONDecodeError:
        return name, value


def _table(table: str, clip: Path) -> list[dict[str, Any]]:
    """Return the settings of each row."""
    if table == EQUAL_BITS:
        return equal_bits.settings(clip)
    return TABLES[table]


def _settings(
    clip: Path, frames: int | None, settings: dict[str, Any], preset: str | None
) -> tuple[dict[str, Any], dict[str, Any]]:
    """What all rows of a clip share, and what this one has of its own."""
    common = bunny.pictures_of(clip, frames)
    if not {"bpp", "crf"} & settings.keys():
        common["params"] = _params(clip, frames)
    if preset is not None:
        settings = {k: v for k, v in settings.items() if k != "time_budget"} | {"preset": preset}
    return common, settings


def _document(
    added: dict[str, Any], rows: list[Row], refused: list[str], studies: dict[str, Study]
) -> dict[str, Any]:
    """What is kept of all that was measured so far."""
    content = document("tests.benchmarks.clips", {"params_per_frame": PARAMS} | added, rows)
    return content | {
        "against": {name: _curves(found) for name, found in studies.items()},
        "at_equal_bits": {name: equal_bits.figures(found) for name, found in studies.items()},
        "refused": refused,
        "summary": list(summary(rows)),
    }


def _params(clip: Path, frames: int | None) -> int:
    """How many numbers to store for a clip: as many a pixel as for Bunny."""
    with open_video(clip, frames=frames) as video:
        count = sum(1 for _ in video)
        return round(PARAMS * count * video.info.width * video.info.height / (1280 * 640))


def _name(row: Row) -> str:
    settings = {k: v for k, v in row.settings.items() if k not in ("gop_max", "preset")}
    words = ", ".join(f"{key} {value}" for key, value in settings.items())
    return f"{Path(row.clip).stem[:16]} {words}"


def _bd_lines(found: Study) -> Iterator[str]:
    for curve in found.curves:
        by_psnr = equal_bits.bd_text(found.bd_rate(curve))
        by_ms_ssim = equal_bits.bd_text(found.bd_rate_ms_ssim(curve))
        yield f"  BD-rate against {curve.label}: {by_psnr}; by MS-SSIM {by_ms_ssim}"


def _curves(found: Study) -> list[dict[str, Any]]:
    """The references of a clip, and the BD-rate against each."""
    result = []
    for curve in found.curves:
        by_psnr, by_ms_ssim = found.bd_rate(curve), found.bd_rate_ms_ssim(curve)
        result.append(
            asdict(curve)
            | {
                "bd_rate": by_psnr and asdict(by_psnr),
                "bd_rate_ms_ssim": by_ms_ssim and asdict(by_ms_ssim),
            }
        )
    return result


def summary(rows: list[Row]) -> Iterator[str]:
    """What the tables over several clips and seeds come to."""
    gops = [row for row in rows if row.table == "gop"]
    if gops:
        means: dict[object, float] = {}
        for length in dict.fromkeys(row.settings["gop"] for row in gops):
            means[length] = fmean(row.psnr for row in gops if row.settings["gop"] == length)
        adaptive = means.pop("adaptive")
        best = max(means, key=lambda length: means[length])
        yield (
            f"adaptive GOPs: {adaptive:.2f} dB, mean of the clips; "
            f"best fixed length {best}: {means[best]:.2f} dB ({adaptive - means[best]:+.2f})"
        )
    seeds = [row for row in rows if row.table == "seeds"]
    if seeds:
        faults = list(diverged(seeds))
        yield f"{len(seeds)} encodes with other seeds, {len(faults)} diverged"
        yield from faults


def diverged(rows: list[Row]) -> Iterator[str]:
    """Say which encodes went astray: no number, or a GOP far below its median over the seeds."""
    for clip in dict.fromkeys(row.clip for row in rows):
        tried = [row for row in rows if row.clip == clip]
        for row in tried:
            values = (row.psnr, row.float_psnr, *row.psnr_gops)
            if not all(map(isfinite, values)):
                yield f"{clip}, {row.settings}: PSNR is not a number"
                continue
            for number, value in enumerate(row.psnr_gops):
                usual = median(r.psnr_gops[number] for r in tried if len(r.psnr_gops) > number)
                if value < usual - _FALL:
                    yield f"{clip}, {row.settings}: GOP {number} {value:.2f} dB, {usual:.2f} usual"


if __name__ == "__main__":
    sys.exit(main())
