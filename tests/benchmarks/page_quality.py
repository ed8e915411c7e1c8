"""The part of the page of results on constant quality: numbers, defaults, presets, still areas."""

from __future__ import annotations

from collections.abc import Iterator
from statistics import fmean

from gsvrcodec.metrics import ms_ssim_db
from tests.benchmarks.markdown import number, origin_of, table
from tests.benchmarks.results_read import Json


def quality_sections(results: dict[str, Json]) -> Iterator[str]:
    """Yield all that was measured of it."""
    yield from crf_section({name: r for name, r in results.items() if name.startswith("crf-")})
    for name, section in SECTIONS.items():
        if name in results:
            yield from section(results[name])
            yield f"* {origin_of(name, results[name])}"
            yield ""


def crf_section(results: dict[str, Json]) -> Iterator[str]:
    """Yield PSNR and bits of each clip and number, beside x264's."""
    rows = [row for result in results.values() for row in result["rows"]]
    if not rows:
        return
    numbers = sorted({row["crf"] for row in rows})
    clips = list(dict.fromkeys(row["clip"] for row in rows))
    yield "## Constant quality beside x264 medium at the same number"
    yield ""
    yield "The first 48 frames: PSNR of ours and of x264, dB, and our bits in those of x264."
    yield ""
    cells = {
        (row["clip"], row["crf"]): f"{row['psnr']:.1f}, {row['x264_psnr']:.1f}, "
        f"x{row['bpp'] / row['x264_bpp']:.1f}"
        for row in rows
    }
    lines = [[clip, *(cells.get((clip, n), "-") for n in numbers)] for clip in clips]
    means = ["mean PSNR"]
    for one in numbers:
        own = [row for row in rows if row["crf"] == one]
        ours, others = (fmean(row[key] for row in own) for key in ("psnr", "x264_psnr"))
        means.append(f"{ours:.2f}, {others:.2f}")
    yield from table(["clip", *(f"`--crf {n:g}`" for n in numbers)], [*lines, means])
    yield from (f"* {origin_of(name, result)}" for name, result in results.items())
    yield ""


def defaults_section(result: Json) -> Iterator[str]:
    """Yield what one gets of each clip without options."""
    frames = result["common"]["frames"]
    yield "## The defaults"
    yield ""
    yield f"The first {frames} frames of each clip, without options. PSNR, dB: of all frames, of"
    yield "the worst one, and where a frame differs from the clip's median picture."
    yield ""
    heads = ["clip", "size", "frames", "bpp", "PSNR", "worst", "moving", "MS-SSIM, dB"]
    yield from table(
        [*heads, "s a frame"],
        (
            [
                row["clip"],
                "x".join(map(str, row["size"])),
                str(row["frames"]),
                number(row["bpp"], 4),
                number(row["psnr"], 2),
                number(row["psnr_min"], 2),
                number(result["moving_psnr"][row["clip"]], 2),
                number(row["ms_ssim"] and ms_ssim_db(row["ms_ssim"]), 2),
                number(row["seconds_per_frame"], 2),
            ]
            for row in result["rows"]
        ),
    )


def presets_section(result: Json) -> Iterator[str]:
    """Yield the means of each preset, and how much better it is than medium at equal size."""
    common, rows = result["common"], result["rows"]
    clips = list(dict.fromkeys(row["clip"] for row in rows))
    yield "## Presets"
    yield ""
    yield f"The first {common['frames']} frames of each clip at `--crf {common['crf']:g}`: seconds"
    yield "a frame, mean of the clips, and PSNR over that of preset medium at equal size, dB."
    yield ""
    lines = []
    for preset in dict.fromkeys(row["preset"] for row in rows):
        own = {row["clip"]: row for row in rows if row["preset"] == preset}
        gains = [own[clip]["gain"] for clip in clips]
        seconds = fmean(row["seconds_per_frame"] for row in own.values())
        gains.append(fmean(gains))
        lines.append([preset, number(seconds, 2), *(f"{gain:+.2f}" for gain in gains)])
    yield from table(["preset", "s a frame", *clips, "mean"], lines)


def still_section(result: Json) -> Iterator[str]:
    """Yield what still areas do from frame to frame."""
    frames = result["common"]["frames"]
    yield "## Still areas before a locked camera"
    yield ""
    yield f"The first {frames} frames without options. Over pixels that never move: variance of"
    yield "the luma over time, and squared difference of successive frames, within a GOP and from"
    yield "one to the next, decoded over source. Above 1 the codec adds noise."
    yield ""
    yield from table(
        ["clip", "still", "bpp", "PSNR", "variance", "within GOPs", "between GOPs"],
        (
            [
                row["clip"],
                f"{row['share']:.0%}",
                number(row["bpp"], 4),
                *(number(row[key], 2) for key in ("psnr", "variance", "within", "between")),
            ]
            for row in result["rows"]
        ),
    )


SECTIONS = {
    "defaults": defaults_section,
    "presets": presets_section,
    "still": still_section,
}
