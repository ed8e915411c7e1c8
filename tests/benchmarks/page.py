"""The page of results, made from what the benchmarks left: `python -m tests.benchmarks.page`.

Reads `tests/benchmarks/results/*.json`, writes `samples/results/README.md` and its plots.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from statistics import fmean, median

from gsvrcodec.report.curve import RateCurve
from tests.benchmarks.clips import EQUAL_BITS
from tests.benchmarks.markdown import number, origin_of, settings_text, table
from tests.benchmarks.page_gpu import gpu_section
from tests.benchmarks.page_quality import quality_sections
from tests.benchmarks.results_plots import plot_rates, plot_times
from tests.benchmarks.results_read import (
    LONG,
    PUBLISHED_TIMES,
    Json,
    load,
    our_curves,
    reference_curves,
    rows_of,
)

RESULTS = Path(__file__).parent / "results"
PAGE = Path(__file__).parents[2] / "samples" / "results"

#: PSNR at which rates are compared, dB.
LEVELS = (33.0, 35.65, 38.29)

#: How the curves of clips that are compared at equal bits are named, after the clip.
_EQUAL_BITS = f", {EQUAL_BITS}"

#: Tables of rows that differ in one setting, and what they show.
ABLATIONS = {
    "deform": "Deformation field",
    "gop": "GOP length",
    "profile": "Profile, GOPs of 24 frames",
    "quantisation": "Fine-tuning under quantisation",
}


def origin(results: dict[str, Json], table: str) -> str:
    """Say which command on what machine a table of Bunny comes from."""
    for name, result in results.items():
        if name.startswith("bunny-") and any(
            row["table"] == table for row in result.get("rows", ())
        ):
            return origin_of(name, result)
    raise KeyError(table)


def rate_section(results: dict[str, Json]) -> Iterator[str]:
    """Yield rate and distortion of Bunny, ours and the others' on the same axes."""
    reference = results["bunny-references"]
    ours, others = our_curves(results), reference_curves(reference)
    yield "## Rate and distortion, Bunny"
    yield ""
    yield "![Rate and distortion](bunny-rd.svg)"
    yield ""
    yield "Bits a pixel for the same mean RGB PSNR; a dash where no encode reaches it. Ours are"
    yield "whole files, the others' the video stream alone."
    yield ""
    rows = []
    for label, points in (ours | others).items():
        curve = RateCurve((psnr, bpp) for bpp, psnr in points)
        rows.append(
            [label, *(number(curve.rate(level), 4) for level in LEVELS), *_speeds(reference, label)]
        )
    rows.append(["GSVR as published", "-", "0.25", "0.37", "", ""])
    heads = [f"bpp at {level:g} dB" for level in LEVELS]
    yield from table(["encoder", *heads, "encode fps", "decode fps"], rows)
    if ours:
        yield "BD-rate of ours: bits more (+) or fewer (-) at equal PSNR, and from where to where:"
        yield ""
        yield from table(["against", *ours], _bd_rows(ours, others))
        for name in ("rate", "rate-2s"):
            if rows_of(results, name):
                yield f"* {origin(results, name)}"
    yield f"* {origin_of('bunny-references', reference)} Versions: {versions(reference)}."
    yield ""


def _speeds(reference: Json, label: str) -> list[str]:
    """Return frames a second of encoding and decoding, medians over the qualities."""
    for curve in reference["curves"]:
        if curve["label"] == label:
            return [
                f"{median(point[name] for point in curve['points']):.0f}"
                for name in ("encode_fps", "decode_fps")
            ]
    return ["", ""]


def versions(reference: Json) -> str:
    """Return the versions of the other encoders."""
    found = {
        curve["reference"]["codec"]: curve["version"]
        for curve in reference["curves"]
        if curve["version"]
    }
    return ", ".join(
        [f"{codec} {version}" for codec, version in found.items()] + [reference["libraries"]]
    )


def _bd_rows(
    ours: dict[str, list[tuple[float, float]]], others: dict[str, list[tuple[float, float]]]
) -> Iterator[list[str]]:
    for label, points in others.items():
        other = RateCurve((psnr, bpp) for bpp, psnr in points)
        cells = []
        for own in ours.values():
            bd_rate = RateCurve((psnr, bpp) for bpp, psnr in own).bd_rate(other)
            cells.append(
                "no PSNR in common"
                if bd_rate is None
                else f"{bd_rate.percent:+.0f} %, {bd_rate.low:.1f} to {bd_rate.high:.1f} dB"
            )
        yield [label, *cells]


def picture_section() -> Iterator[str]:
    """Yield what a person sees of Bunny, beside x264."""
    yield "## Pictures, Bunny"
    yield ""
    yield "The frame in which most moves, at a low rate (`--crf 32 --time-budget 2`), beside x264"
    yield "medium with a key frame every 12 at the same bits; below it, its fastest part at twice"
    yield "the size. Above each stand the bits a pixel of the file and the PSNR of what is shown."
    yield "What stands or moves slowly keeps its edges; what is fast is soft and streaky at the"
    yield "ends of a long GOP, where x264 shows blocks."
    yield ""
    yield "![Source, ours and x264, a whole frame](rate-2s-1-0.png)"
    yield ""
    yield "![Source, ours and x264, a fast part](rate-2s-1-0-crop1.png)"
    yield ""
    command = "python -m tests.benchmarks.pictures samples/bigbuckbunny.mp4 rate-2s-1.gsvr"
    yield f"* `{command} --out samples/results`."
    yield ""


def time_section(results: dict[str, Json]) -> Iterator[str]:
    """Yield PSNR against the time of the encode, beside the publication's."""
    rows = rows_of(results, "time") + rows_of(results, "slow")
    yield "## PSNR against time, Bunny, at most 3M parameters"
    yield ""
    yield "![PSNR against time](bunny-time.svg)"
    yield ""
    published = {seconds: f"{psnr:.2f}" for seconds, psnr in PUBLISHED_TIMES}
    yield from table(
        [
            "seconds a frame",
            "publication, RTX A6000",
            "ours",
            "worst frame",
            "before quantisation",
            "bpp",
        ],
        (
            [
                number(row["seconds_per_frame"], 2),
                published.get(row["settings"].get("time_budget", 0), "-"),
                number(row["psnr"], 2),
                number(row["psnr_min"], 2),
                number(row["float_psnr"], 2),
                number(row["bpp"], 4),
            ]
            for row in rows
        ),
    )
    yield f"* {origin(results, 'time')}"
    yield ""


def ablation_section(results: dict[str, Json], name: str, title: str) -> Iterator[str]:
    """Yield a table of rows that differ in one setting."""
    yield f"## {title}, Bunny"
    yield ""
    yield from table(
        ["settings", "PSNR", "worst frame", "bpp", "GOPs", "seconds a frame"],
        (
            [
                settings_text(row),
                number(row["psnr"], 2),
                number(row["psnr_min"], 2),
                number(row["bpp"], 4),
                str(row["gops"]),
                number(row["seconds_per_frame"], 2),
            ]
            for row in rows_of(results, name)
        ),
    )
    yield f"* {origin(results, name)}"
    yield ""


def bits_section(results: dict[str, Json]) -> Iterator[str]:
    """Yield what the bits of the files are spent on."""
    rows = rows_of(results, "rate") + rows_of(results, "rate-2s")
    items = list(dict.fromkeys(name for row in rows for name in row["bits_per_gaussian"]))
    yield "## Bits a Gaussian, Bunny"
    yield ""
    yield from table(
        ["settings", "PSNR", *items, "all"],
        (
            [
                settings_text(row),
                number(row["psnr"], 2),
                *(number(row["bits_per_gaussian"].get(item), 1) for item in items),
                number(sum(row["bits_per_gaussian"].values()), 1),
            ]
            for row in rows
        ),
    )


def interpolation_section(results: dict[str, Json]) -> Iterator[str]:
    """Yield how well frames come out that were never seen."""
    for name, result in results.items():
        if "interpolation" in result:
            found = result["interpolation"]
            yield "## Interpolation, Bunny"
            yield ""
            yield "Every second frame is encoded; the decoder renders the times between."
            yield ""
            yield from table(
                ["", "seen", "between", "between, inside a GOP"],
                [
                    ["ours", *(number(found[key], 2) for key in ("train", "test", "test_inside"))],
                    ["publication, mean of UVG", "31.16", "29.49", "-"],
                ],
            )
            yield f"* {origin_of(name, result)}"
            yield ""


def bd_section(results: dict[str, Json], names: str, frames: int) -> Iterator[str]:
    """Yield the BD-rates of the clips that are compared at equal bits, and their means.

    Args:
        results: All that is measured.
        names: How the names of those with so many frames begin.
        frames: First ones of each clip.
    """
    curves = {
        (key.removesuffix(_EQUAL_BITS), curve["label"]): curve
        for name, result in results.items()
        if name.startswith(names)
        for key, found in result.get("against", {}).items()
        if key.endswith(_EQUAL_BITS)
        for curve in found
    }
    if not curves:
        return
    clips, labels = (list(dict.fromkeys(names)) for names in zip(*curves, strict=True))
    yield f"## Against other encoders, the first {frames} frames of other clips"
    yield ""
    yield "Bits of ours more (+) or fewer (-) at equal PSNR, and in brackets at equal MS-SSIM, %:"
    yield "BD-rates over what both reach. Ours takes a second a frame of 1280x720, in proportion to"
    yield "the pixels, and two at most. The curves of each clip are below."
    yield ""
    rows = [[clip, *(_percents([curves[clip, label]]) for label in labels)] for clip in clips]
    rows.append(["mean", *(_percents([curves[c, label] for c in clips]) for label in labels)])
    yield from table(["clip", *labels], rows)


def _percents(curves: list[Json]) -> str:
    """Return the mean BD-rates of curves by PSNR and by MS-SSIM, of those that have one."""
    means = []
    for key in ("bd_rate", "bd_rate_ms_ssim"):
        known = [curve[key]["percent"] for curve in curves if curve[key]]
        means.append(f"{fmean(known):+.0f}" if known else "-")
    return f"{means[0]} ({means[1]})"


def clips_section(results: dict[str, Json]) -> Iterator[str]:
    """Yield the tables of other clips."""
    for name, result in results.items():
        if not name.startswith("clips-"):
            continue
        yield f"## Other clips ({name.removeprefix('clips-')})"
        yield ""
        yield from table(
            ["clip", "size", "settings", "PSNR", "worst frame", "bpp", "seconds a frame", "GB"],
            (
                [
                    row["clip"],
                    "x".join(map(str, row["size"])),
                    settings_text(row),
                    number(row["psnr"], 2),
                    number(row["psnr_min"], 2),
                    number(row["bpp"], 4),
                    number(row["seconds_per_frame"], 2),
                    number(row["memory"] and row["memory"] / 1e9, 1),
                ]
                for row in result["rows"]
            ),
        )
        if result["against"]:
            curves = [(c, curve) for c, found in result["against"].items() for curve in found]
            both = any("bd_rate_ms_ssim" in curve for _, curve in curves)
            yield from table(
                [
                    *("clip", "BD-rate against", "bits", "over"),
                    *(("bits by MS-SSIM", "over") if both else ()),
                ],
                (_clip_bd(clip, curve, both) for clip, curve in curves),
            )
        for clip, rows in result.get("at_equal_bits", {}).items():
            yield from _equal_bits(clip, rows)
        yield from (f"* {line}" for line in (*result["summary"], *result["refused"]))
        yield f"* {origin_of(name, result)}"
        yield ""


def _clip_bd(clip: str, curve: Json, both: bool) -> list[str]:
    cells = [clip, curve["label"]]
    for key, quality in (("bd_rate", "PSNR"), ("bd_rate_ms_ssim", "MS-SSIM"))[: 1 + both]:
        bd_rate = curve.get(key)
        if bd_rate is None:
            cells += ["-", f"no {quality} in common"]
        else:
            span = f"{bd_rate['low']:.1f} to {bd_rate['high']:.1f} dB"
            cells += [f"{bd_rate['percent']:+.0f} %", span]
    return cells


def _equal_bits(clip: str, rows: list[Json]) -> Iterator[str]:
    """Yield PSNR and MS-SSIM of ours and of the others at the same bits."""
    labels = list(rows[0]["others"])
    yield f"{clip}: PSNR and MS-SSIM (-10 log10(1 - MS-SSIM)) at equal bits, dB."
    yield ""
    yield from table(
        ["bpp", "ours", *labels],
        (
            [
                number(row["bpp"], 4),
                *(
                    f"{number(one['psnr'], 2)}, {number(one['ms_ssim_db'], 2)}"
                    for one in (row, *(row["others"][label] for label in labels))
                ),
            ]
            for row in rows
        ),
    )


def page(results: dict[str, Json]) -> str:
    """Return the page in Markdown."""
    lines = [
        "# Results",
        "",
        "Made by `python -m tests.benchmarks.page` from what is measured in",
        "[tests/benchmarks/results](../../tests/benchmarks/results). Bunny is 132 frames of Big",
        "Buck Bunny, cropped to 1280x640; PSNR is the mean over the frames of the PSNR of 8-bit",
        "RGB, from the final file. Other encoders get the samples of the source, YCbCr 4:2:0, not",
        'the RGB made of them, which costs them up to 3 dB; "from RGB" is with that conversion.',
        '"tune psnr" is x264 without its settings for the eye, which cost PSNR.',
        "Preset fast, in older tables, visited each frame 25 times.",
        "",
        "Results marked **sums** are older than bitstream 1.0-rc2, in which pictures are weighted",
        "means of Gaussians instead of sums. They have not been measured anew.",
        "",
        *rate_section(results),
        *bd_section(results, "clips-bits-", 96),
        *bd_section(results, LONG, 240),
        *picture_section(),
        *quality_sections(results),
        *time_section(results),
    ]
    if "gpu" in results:
        lines += gpu_section(results["gpu"])
    for name, title in ABLATIONS.items():
        if rows_of(results, name):
            lines += ablation_section(results, name, title)
    if our_curves(results):
        lines += bits_section(results)
    lines += [*interpolation_section(results), *clips_section(results)]
    return "\n".join(lines).rstrip() + "\n"


def main() -> None:
    """Write the page and its plots."""
    results = load(RESULTS)
    PAGE.mkdir(exist_ok=True)
    (PAGE / "README.md").write_text(page(results))
    plot_rates(results, PAGE / "bunny-rd.svg")
    plot_times(results, PAGE / "bunny-time.svg")


if __name__ == "__main__":
    main()
