"""What the benchmarks left, and what the publication says of the same."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

Json = dict[str, Any]

#: The publication's figures for Bunny: seconds a frame on an RTX A6000 and dB; bpp and dB.
PUBLISHED_TIMES = ((0.5, 33.17), (1.0, 34.60), (1.5, 35.14), (2.0, 35.48))
PUBLISHED_RATES = ((0.25, 35.65), (0.37, 38.29))


#: How the names of results begin that have more frames of clips than 96.
LONG = "clips-long-"


def load(folder: Path) -> dict[str, Json]:
    """Return every result by the name of its file."""
    return {path.stem: json.loads(path.read_text()) for path in sorted(folder.glob("*.json"))}


def rows_of(results: dict[str, Json], table: str) -> list[Json]:
    """Return the rows of a table of Bunny."""
    return [
        row
        for name, result in results.items()
        if name.startswith("bunny-")
        for row in result.get("rows", ())
        if row["table"] == table
    ]


def our_curves(results: dict[str, Json]) -> dict[str, list[tuple[float, float]]]:
    """Return bpp and PSNR of our points, by a label for each time an encode may take."""
    rows = [row for name in ("rate", "rate-2s") for row in rows_of(results, name)]
    curves = {}
    for seconds in (4.0, 2.0):
        points = [r for r in rows if r["settings"].get("time_budget") == seconds]
        if points:
            label = f"GSVR, {seconds:.0f} s a frame"
            curves[label] = sorted((row["bpp"], row["psnr"]) for row in points)
    return curves


def reference_curves(reference: Json) -> dict[str, list[tuple[float, float]]]:
    """Return bpp and PSNR of the other encoders' points."""
    return {
        curve["label"]: [(p["bpp"], p["quality"]["psnr_rgb"]) for p in curve["points"]]
        for curve in reference["curves"]
    }
