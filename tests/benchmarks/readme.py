"""The tables of the README, from what the benchmarks left: `python -m tests.benchmarks.readme`.

Each stands between `<!-- NAME -->` and `<!-- /NAME -->`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from statistics import fmean

from gsvrcodec.report.curve import RateCurve
from tests.benchmarks.clips import EQUAL_BITS
from tests.benchmarks.markdown import number, table
from tests.benchmarks.page import LEVELS, RESULTS
from tests.benchmarks.results_read import (
    PUBLISHED_RATES,
    PUBLISHED_TIMES,
    Json,
    load,
    our_curves,
    reference_curves,
    rows_of,
)

README = Path(__file__).parents[2] / "README.md"

#: Other encoders, as they are named in the data and here.
_OTHERS = {
    "x264 medium all intra": "x264 medium, all intra",
    "x264 medium key 12": "x264 medium, a key frame every 12",
    "x264 medium": "x264 medium",
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
            rows.append([says, *(f"{psnr:+.0f} ({similar:+.0f})" for psnr, similar in pairs)])
    means = [
        tuple(fmean(pairs[column][kind] for pairs in percents) for kind in (0, 1))
        for column in range(len(labels))
    ]
    rows.append(["mean", *(f"{psnr:+.0f} ({similar:+.0f})" for psnr, similar in means)])
    yield from table(["clip", "x264 medium, key 12", "x264 medium"], rows)


def _percents(curve: Json) -> tuple[float, float]:
    return curve["bd_rate"]["percent"], curve["bd_rate_ms_ssim"]["percent"]


TABLES: Mapping[str, Callable[[dict[str, Json]], Iterator[str]]] = {
    "times": times,
    "rates": rates,
    "clips": clips,
}


def filled(text: str, results: dict[str, Json]) -> str:
    """Return the README with its tables as the results have them."""
    for name, rows in TABLES.items():
        before, begin, rest = text.partition(f"<!-- {name} -->\n")
        _, end, after = rest.partition(f"<!-- /{name} -->")
        assert begin, name
        assert end, name
        text = before + begin + "\n".join(rows(results)).rstrip() + "\n" + end + after
    return text


def main() -> None:
    """Write the README anew."""
    README.write_text(filled(README.read_text("utf-8"), load(RESULTS)))


if __name__ == "__main__":
    main()
