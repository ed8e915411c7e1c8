"""The publication's tables for this codec: `python -m tests.benchmarks.bunny [TABLE ...]`.

Encodes the benchmark clip (132 frames, cropped to 1280x640, at most 3M parameters), decodes the
file and measures it against the source. Prints a line as soon as it is known; `--json` keeps all.
`python -m tests.benchmarks.page` makes tables and plots of what is kept.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from tests.benchmarks.encodes import HEADING, Row, document, measure, save, show
from tests.benchmarks.interpolation import Interpolation, interpolate
from tests.benchmarks.machine import machine

SOURCE = Path(__file__).parents[2] / "samples" / "bigbuckbunny.mp4"
CROP = (1280, 640, None, None)
PARAMS = 3_000_000
#: Constant qualities, from 32 dB to more than the 38.29 dB of the publication.
CRFS = (37, 32, 27, 21)

#: Settings of each row, by table. The publication's times are seconds a frame on an RTX A6000.
TABLES: Mapping[str, list[dict[str, Any]]] = {
    "time": [{"time_budget": seconds} for seconds in (0.5, 1.0, 2.0)],
    "slow": [{"time_budget": 4.0}],
    "deform": [
        {"time_budget": 0.5, "deform": deform} for deform in ("hybrid", "triplane", "polynomial")
    ],
    "gop": [
        {"time_budget": 0.5, "gop": gop, "gop_max": 100} for gop in (15, 30, 60, 100, "adaptive")
    ],
    "profile": [
        {"time_budget": 1.0, "profile": profile, "gop": 24} for profile in ("main", "paper")
    ],
    "quantisation": [{"time_budget": 0.5, "qat": qat} for qat in (True, False)],
    "rate": [{"time_budget": 4.0, "crf": crf} for crf in CRFS[2:]],
    "rate-2s": [{"time_budget": 2.0, "crf": crf} for crf in CRFS],
}
INTERPOLATION = "interpolation"
#: Tables of a quarter of an hour and more.
LONG = ("slow", "rate")


def pictures_of(clip: Path, frames: int | None) -> dict[str, Any]:
    """Settings that encode the first pictures of any clip alone; of this one, cropped."""
    common: dict[str, Any] = {"frames": frames, "audio": False, "subtitles": False}
    if clip.name == SOURCE.name:
        common["crop"] = CROP
    return common


@click.command()
@click.argument("tables", nargs=-1, type=click.Choice([*TABLES, INTERPOLATION]))
@click.option("--frames", type=click.IntRange(min=2), help="The first ones only, to try it out.")
@click.option("--preset", help="Instead of all times, to try it out.")
@click.option("--keep", type=click.Path(path_type=Path), help="Directory for the .gsvr files.")
@click.option("--json", "output", type=click.Path(path_type=Path), help="Write the rows here.")
def main(
    tables: tuple[str, ...],
    frames: int | None,
    preset: str | None,
    keep: Path | None,
    output: Path | None,
) -> None:
    """Measure TABLES, or all but "slow" and "rate", which take a quarter of an hour and more."""
    print(machine())
    print(HEADING)
    params = PARAMS if frames is None else PARAMS * frames // 132
    common = pictures_of(SOURCE, frames)
    rows: list[Row] = []
    between: Interpolation | None = None
    with tempfile.TemporaryDirectory() as temporary:
        folder = keep or Path(temporary)
        folder.mkdir(exist_ok=True)
        for table in tables or [name for name in (*TABLES, INTERPOLATION) if name not in LONG]:
            if table == INTERPOLATION:
                settings = _hurried({"params": params // 2, "time_budget": 2.0}, preset)
                between = interpolate(SOURCE, CROP, frames, settings, Path(temporary))
                print(
                    f"interpolation: {between.train:.2f} dB seen, {between.test:.2f} dB between, "
                    f"{between.test_inside:.2f} dB between and inside of a GOP"
                )
            for number, settings in enumerate(TABLES.get(table, [])):
                path = folder / f"{table}-{number}.gsvr"
                size = {} if "crf" in settings else {"params": params}
                rows.append(measure(table, SOURCE, path, _hurried(settings, preset), common | size))
                show(rows[-1])
                if output is not None:
                    save(output, _document(common | {"params": params}, rows, between))
            if output is not None:
                save(output, _document(common | {"params": params}, rows, between))


def _document(
    common: Mapping[str, Any], rows: list[Row], between: Interpolation | None
) -> dict[str, Any]:
    """What is kept of all that was measured so far."""
    content = document("tests.benchmarks.bunny", common, rows)
    if between is not None:
        content[INTERPOLATION] = asdict(between)
    return content


def _hurried(settings: dict[str, Any], preset: str | None) -> dict[str, Any]:
    """The settings with a preset instead of a time."""
    if preset is None:
        return settings
    return {k: v for k, v in settings.items() if k != "time_budget"} | {"preset": preset}


if __name__ == "__main__":
    sys.exit(main())
