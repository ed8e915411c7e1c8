"""Plots of rate-distortion curves and of PSNR over frames. Needs matplotlib."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gsvrcodec.errors import UsageError
from gsvrcodec.report.compare import Report
from gsvrcodec.report.study import Study

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PLOT_FORMATS = (".png", ".svg", ".pdf")

#: Line colour of each encoder; markers and line styles of its variants.
_COLOURS = {"x264": "tab:blue", "x265": "tab:orange", "svtav1": "tab:green"}
_VARIANTS = ("o-", "s--", "^:", "v-.", "D-")

_MISSING = "plots need matplotlib: pip install matplotlib"


def plot(study: Study, path: str | os.PathLike[str], *, format: str | None = None) -> None:
    """Plot the PSNR of every frame; above it rate-distortion, if there is more than one point.

    Args:
        study: The measurements to plot.
        path: The file to write.
        format: "png", "svg" or "pdf"; None = by the suffix of `path`.

    Raises:
        UsageError: matplotlib is not installed, or the format is not supported.
    """
    format = check_plot(path, format)
    curves = len(study.reports) > 1 or bool(study.curves)
    figure = _figure(8, 10 if curves else 4)
    if curves:
        upper, lower = figure.subplots(2, height_ratios=(3, 2))
        plot_rates(upper, study)
        plot_frames(lower, study.reports)
    else:
        plot_frames(figure.subplots(), study.reports)
    figure.text(
        0.99, 0.002, f"{study.machine}; {study.libraries}", ha="right", va="bottom", fontsize=6
    )
    figure.savefig(path, format=format)


def check_plot(path: str | os.PathLike[str], format: str | None = None) -> str:
    """Return the format in which `plot` would write; arguments and errors as there."""
    format = format or Path(path).suffix.lower().removeprefix(".")
    if f".{format}" not in PLOT_FORMATS:
        raise UsageError(f"{path}: a plot is written as {', '.join(PLOT_FORMATS)}")
    if find_spec("matplotlib") is None:
        raise UsageError(_MISSING)
    return format


def plot_rates(axes: Axes, study: Study) -> None:
    """Plot mean PSNR over bits a pixel, of the .gsvr files and of the references."""
    ours = sorted((report.bpp, report.psnr_rgb) for report in study.reports)
    axes.plot(*zip(*ours, strict=True), "o-", linewidth=2.5, color="black", label="GSVR")
    styles = reference_styles(curve.reference.codec for curve in study.curves)
    for curve, style in zip(study.curves, styles, strict=True):
        points = [(point.bpp, point.quality.psnr_rgb) for point in curve.points]
        label = f"{curve.label} ({curve.version})" if curve.version else curve.label
        axes.plot(*zip(*points, strict=True), **style, label=label)
    axes.set(xscale="log", xlabel="bits a pixel and frame", ylabel="mean RGB PSNR, dB")
    axes.grid(visible=True, which="both", linewidth=0.3)
    axes.legend(fontsize=8)


def reference_styles(codecs: Iterable[str]) -> Iterator[dict[str, Any]]:
    """Yield line styles for curves of `codecs`: one colour an encoder, one marker a variant."""
    seen: Counter[str] = Counter()
    for codec in codecs:
        variant = _VARIANTS[seen[codec] % len(_VARIANTS)]
        seen[codec] += 1
        yield {
            "color": _COLOURS[codec],
            "marker": variant[0],
            "linestyle": variant[1:],
            "linewidth": 1,
            "markersize": 3,
        }


def plot_frames(axes: Axes, reports: tuple[Report, ...]) -> None:
    """Plot the PSNR of every frame of each file, and the mean of each file."""
    for report in reports:
        values = [frame.psnr_rgb for frame in report.frames]
        label = f"{Path(report.file).name}: {report.psnr_rgb:.2f} dB at {report.bpp:.4f} bpp"
        (line,) = axes.plot([frame.frame for frame in report.frames], values, label=label)
        axes.axhline(report.psnr_rgb, color=line.get_color(), linestyle="--", linewidth=1)
    axes.set(xlabel="frame", ylabel="RGB PSNR, dB")
    axes.legend(fontsize=8)


def _figure(width: float, height: float) -> Figure:
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise UsageError(_MISSING) from error
    return Figure(figsize=(width, height), layout="constrained")
