"""The table of clips beside others at equal bits: what to encode at, and how they compare."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from gsvrcodec.metrics import ms_ssim_db
from gsvrcodec.report.curve import BdRate
from gsvrcodec.report.study import Study
from gsvrcodec.video import open_video, reading_options
from tests.benchmarks.bunny import pictures_of

#: Frames of each clip, if nothing else is asked for.
FRAMES = 96
#: Each clip is encoded at these numbers of the scale of constant quality.
CRFS = (36, 31, 26, 20)
AGAINST = ("x264:key=12", "x264", "x265", "svtav1")

#: Time of an encode: a second for a frame of 1280x720, in proportion to the pixels, at most two.
_PIXELS_A_SECOND = 1280 * 720
_MOST_SECONDS = 2.0

Json = dict[str, Any]


def seconds(width: int, height: int) -> float:
    """Return the time that an encode may take, seconds a frame."""
    return round(min(_MOST_SECONDS, width * height / _PIXELS_A_SECOND), 2)


def settings(clip: Path) -> list[Json]:
    """Return quality and time of each row of a clip."""
    with open_video(clip, **reading_options(pictures_of(clip, None))) as video:
        time = seconds(video.info.width, video.info.height)
    return [{"crf": crf, "time_budget": time} for crf in CRFS]


def figures(found: Study) -> list[Json]:
    """Return each file's PSNR and MS-SSIM in dB, and what the others have at its bits.

    None = the others were not measured at so many or so few bits, or the frames are too small.
    """
    rows = []
    for report in found.reports:
        others = {}
        for curve in found.curves:
            similar = curve.ms_ssim_curve
            others[curve.label] = {
                "psnr": curve.rate_curve.quality_at(report.bpp),
                "ms_ssim_db": similar and similar.quality_at(report.bpp),
            }
        rows.append(
            {
                "bpp": report.bpp,
                "psnr": report.psnr_rgb,
                "ms_ssim_db": None if report.ms_ssim is None else ms_ssim_db(report.ms_ssim),
                "others": others,
            }
        )
    return rows


def lines(rows: Iterable[Json]) -> Iterator[str]:
    """Yield `figures` as a table: ours, and by how much it is better than each of the others."""
    rows = list(rows)
    labels = list(rows[0]["others"])
    yield "  at equal bits: PSNR and MS-SSIM in dB, and how much better than the others"
    yield f"  {'bpp':>8}{'ours':>14}" + "".join(f"{label:>20}" for label in labels)
    for row in rows:
        cells = [f"{row['psnr']:7.2f}{_number(row['ms_ssim_db'], '7.2f')}"]
        for other in row["others"].values():
            gains = (
                None if row[name] is None or other[name] is None else row[name] - other[name]
                for name in ("psnr", "ms_ssim_db")
            )
            cells.append(f"{' ' * 6}{''.join(_number(gain, '+7.2f') for gain in gains)}")
        yield f"  {row['bpp']:8.4f}" + "".join(cells)


def bd_text(bd_rate: BdRate | None) -> str:
    """Return a BD-rate in words."""
    if bd_rate is None:
        return "nothing in common"
    return f"{bd_rate.percent:+.0f} % from {bd_rate.low:.1f} to {bd_rate.high:.1f} dB"


def _number(value: float | None, form: str) -> str:
    return f"{'-':>7}" if value is None else format(value, form)
