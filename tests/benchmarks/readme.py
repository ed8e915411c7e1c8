"""Figures of README and docs, from what the benchmarks left: `python -m tests.benchmarks.readme`.

Each table stands between `<!-- NAME -->` and `<!-- /NAME -->`. With `--record` the README's own
commands are run first, for what they print.
"""

from __future__ import annotations

import re
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from statistics import fmean
from subprocess import PIPE, STDOUT

import click

from gsvrcodec.report.curve import RateCurve
from tests.benchmarks.clips import EQUAL_BITS
from tests.benchmarks.markdown import number, table
from tests.benchmarks.page import LEVELS, RESULTS
from tests.benchmarks.page_gpu import speeds
from tests.benchmarks.results_read import (
    LONG,
    PUBLISHED_RATES,
    PUBLISHED_TIMES,
    Json,
    load,
    our_curves,
    reference_curves,
    rows_of,
)

ROOT = Path(__file__).parents[2]
PAGES = ("README.md", "docs/install.md", "docs/benchmarks.md", "docs/comparison.md")

#: What the README's commands print, and those of its commands that print.
PRINTED = RESULTS / "first-output.txt"
_SAMPLE = "samples/bunny_24f_320x180_audio.mp4"
_FIRST = (
    ("gsvrenc", "-y", _SAMPLE, "bunny.gsvr"),
    ("gsvrreport", _SAMPLE, "bunny.gsvr"),
)

#: Other encoders, as they are named in the data and here.
_OTHERS = {
    "x264 medium all intra": "x264 medium, all intra",
    "x264 medium key 12": "x264 medium, a key frame every 12",
    "x264 medium": "x264 medium",
    "x265 medium": "x265 medium",
    "SVT-AV1 8": "SVT-AV1 preset 8",
}
#: Those of the README's table.
_AGAINST = {
    "x264 medium": "x264 medium",
    "x264 medium key 12": "x264, key frame every 12",
    "x265 medium": "x265 medium",
    "SVT-AV1 8": "SVT-AV1 preset 8",
}
#: Clips, as they are named in the data and here.
_CLIPS = {
    "soccer_juggle_720p.mp4": "football player, locked camera",
    "blocks_720p.mp4": "hands that build, locked camera",
    "coffee_720p.mp4": "hands and a cup, locked camera",
    "bee_macro_720p.mp4": "macro of a bee",
    "cup.mp4": "cup, moved by a hand",
    "handheld_flower_720p.264": "flower, hand-held camera",
    "driving_1080p.264": "drive",
}


def times(results: dict[str, Json]) -> Iterator[str]:
    """Yield PSNR by the time of an encode, beside the publication's."""
    published = dict(PUBLISHED_TIMES)
    heads = ("seconds a frame", "publication, RTX A6000", "ours, 2 CPU cores", "worst frame", "bpp")
    rows = []
    for row in rows_of(results, "time"):
        seconds = row["settings"]["time_budget"]
        rows.append(
            [
                f"{seconds:.1f}",
                f"{published[seconds]:.2f} dB",
                f"{row['psnr']:.2f} dB",
                f"{row['psnr_min']:.2f} dB",
                number(row["bpp"], 3),
            ]
        )
    yield from table(heads, rows)


def rates(results: dict[str, Json]) -> Iterator[str]:
    """Yield bits a pixel at three qualities, of ours and of others."""
    (ours,) = our_curves(results).values()
    others = reference_curves(results["bunny-references"])
    curves = {"ours": ours} | {name: others[label] for label, name in _OTHERS.items()}
    rows = []
    for name, points in curves.items():
        curve = RateCurve((psnr, bpp) for bpp, psnr in points)
        rows.append([name, *(number(curve.rate(level), 4) for level in LEVELS)])
    published = {psnr: f"{bpp:g}" for bpp, psnr in PUBLISHED_RATES}
    own = (published.get(level, "-") for level in LEVELS)
    rows.insert(1, ["GSVR as published, 3M and 4.5M parameters", *own])
    yield from table(["encoder", *(f"bpp at {level:g} dB" for level in LEVELS)], rows)


def clips(results: dict[str, Json]) -> Iterator[str]:
    """Yield BD-rates against x264, by PSNR and by MS-SSIM."""
    labels = ("x264 medium key 12", "x264 medium")
    rows, percents = [], []
    for name, says in _CLIPS.items():
        found = {
            curve["label"]: curve
            for result in results.values()
            for curve in result.get("against", {}).get(f"{name}, {EQUAL_BITS}", ())
        }
        if found:
            pairs = [_percents(found[label]) for label in labels]
            percents.append(pairs)
            rows.append([says, *(f"{psnr:+z.0f} ({similar:+z.0f})" for psnr, similar in pairs)])
    means = [
        tuple(fmean(pairs[column][kind] for pairs in percents) for kind in (0, 1))
        for column in range(len(labels))
    ]
    rows.append(["mean", *(f"{psnr:+z.0f} ({similar:+z.0f})" for psnr, similar in means)])
    yield from table(["clip", "x264 medium, key 12", "x264 medium"], rows)


def _percents(curve: Json) -> tuple[float, float]:
    return curve["bd_rate"]["percent"], curve["bd_rate_ms_ssim"]["percent"]


def against(results: dict[str, Json]) -> Iterator[str]:
    """Yield BD-rates of Bunny and of video that people shoot, and how fast others encode."""
    (ours,) = our_curves(results).values()
    bunny = reference_curves(results["bunny-references"])
    rows = [["Big Buck Bunny", *(_percent(ours, bunny[label]) for label in _AGAINST)]]
    percents = [
        [_bd(points, others[label]) for label in _AGAINST] for points, others in _shot(results)
    ]
    means = (f"{fmean(column):+z.0f}" for column in zip(*percents, strict=True))
    rows.append([f"{len(percents)} clips that people shot, mean", *means])
    columns = zip(*percents, strict=True)
    rows.append(["best and worst", *(f"{min(c):+z.0f}, {max(c):+z.0f}" for c in columns)])
    yield from table(["", *_AGAINST.values()], rows)
    speeds = [
        fmean(point["encode_fps"] for point in curve["points"])
        for curve in results["bunny-references"]["curves"]
        if curve["label"] in _AGAINST
    ]
    seconds = next(row for row in rows_of(results, "rate-2s"))["settings"]["time_budget"]
    shot = {
        row["settings"]["time_budget"]
        for result in results.values()
        for row in result.get("rows", ())
        if row.get("table") == EQUAL_BITS and row["clip"] in _CLIPS
    }
    yield (
        f"Ours took {seconds:g} s a frame of Bunny and {min(shot):g} to {max(shot):g} s of the "
        f"others on 2 cores; they encode {min(speeds):.0f} to {max(speeds):.0f} frames a second."
    )


def _shot(
    results: dict[str, Json],
) -> Iterator[tuple[list[tuple[float, float]], dict[str, list[tuple[float, float]]]]]:
    """Yield our points of each clip that people shot, rate and PSNR, and those of the others."""
    for clip in _CLIPS:
        others: dict[str, list[tuple[float, float]]] = {}
        points: list[tuple[float, float]] = []
        for result in results.values():
            found = result.get("against", {}).get(f"{clip}, {EQUAL_BITS}")
            if found:
                points = [
                    (row["bpp"], row["psnr"]) for row in result["rows"] if row["clip"] == clip
                ]
                others |= reference_curves({"curves": found})
            elif result.get("source") == clip:
                others |= reference_curves(result)
        yield points, others


def _bd(ours: list[tuple[float, float]], others: list[tuple[float, float]]) -> float:
    curves = [RateCurve((psnr, bpp) for bpp, psnr in points) for points in (ours, others)]
    found = curves[0].bd_rate(curves[1])
    assert found is not None
    return found.percent


def _percent(ours: list[tuple[float, float]], others: list[tuple[float, float]]) -> str:
    return f"{_bd(ours, others):+z.0f}"


def output(results: dict[str, Json]) -> Iterator[str]:
    """Yield what the README's commands print at their end."""
    encode, *report = PRINTED.read_text("utf-8").rstrip().split("\n$ ")
    yield "```text"
    yield encode.splitlines()[-1]
    yield from (line for line in "".join(report).splitlines() if line.startswith(("PSNR", "dec")))
    yield "```"


def sizes(results: dict[str, Json]) -> Iterator[str]:
    """Yield time and size of an installation."""
    rows = [
        [row["way"], f"{row['seconds']} s", f"{row['megabytes']} MB"]
        for row in results["install"]["rows"]
    ]
    yield from table(["on 2 cores, from packages that are there", "time", "size"], rows)


def resolutions(results: dict[str, Json]) -> Iterator[str]:
    """Yield time and memory of an encode and of decoding, by the size of the picture."""
    heads = ("size", "PSNR", "encode, s a frame", "memory", "decode, frames a second", "memory")
    rows = [
        [
            f"{row['width']}x{row['height']}",
            f"{row['psnr']:.1f} dB",
            f"{row['seconds']:.2f}",
            f"{row['megabytes']:.0f} MB",
            f"{row['decoded']:.0f}",
            f"{row['decode_megabytes']:.0f} MB",
        ]
        for row in results["resolutions"]["rows"]
    ]
    yield from table(heads, rows)


TABLES: Mapping[str, Callable[[dict[str, Json]], Iterator[str]]] = {
    "times": times,
    "rates": rates,
    "clips": clips,
    "against": against,
    "output": output,
    "sizes": sizes,
    "resolutions": resolutions,
    "gpu": lambda results: speeds(results["gpu"]),
}


def filled(text: str, results: dict[str, Json]) -> str:
    """Return a page with its tables as the results have them, of 96 frames of each clip."""
    results = {name: found for name, found in results.items() if not name.startswith(LONG)}
    for name in re.findall(r"^<!-- (\w+) -->$", text, re.MULTILINE):
        before, begin, rest = text.partition(f"<!-- {name} -->\n")
        _, end, after = rest.partition(f"<!-- /{name} -->")
        assert end, name
        text = before + begin + "\n".join(TABLES[name](results)).rstrip() + "\n" + end + after
    return text


def record() -> None:
    """Run the README's commands, and keep what they print."""
    lines = []
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "samples").symlink_to(ROOT / "samples")
        for words in _FIRST:
            run = subprocess.run(
                words, cwd=folder, text=True, check=True, stdout=PIPE, stderr=STDOUT
            )
            lines += [f"$ {' '.join(words)}", *run.stdout.splitlines()]
    PRINTED.write_text("\n".join(lines) + "\n")


@click.command()
@click.option("--record", "anew", is_flag=True, help="Run the README's commands first.")
def main(anew: bool) -> None:
    """Write the pages anew."""
    if anew:
        record()
    results = load(RESULTS)
    for page in PAGES:
        path = ROOT / page
        path.write_text(filled(path.read_text("utf-8"), results))


if __name__ == "__main__":
    main()
