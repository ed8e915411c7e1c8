"""The plots of the page of results. Needs matplotlib."""

from __future__ import annotations

from pathlib import Path

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gsvrcodec.report.plot import reference_styles
from tests.benchmarks.results_read import (
    PUBLISHED_RATES,
    PUBLISHED_TIMES,
    Json,
    our_curves,
    reference_curves,
    rows_of,
)


def plot_rates(results: dict[str, Json], path: Path) -> None:
    """Draw PSNR over bits a pixel of Bunny, ours and the others' on the same axes."""
    figure, axes = _axes("bits a pixel and frame")
    for (label, points), colour in zip(our_curves(results).items(), ("black", "red"), strict=False):
        axes.plot(*zip(*points, strict=True), "o-", linewidth=2.5, color=colour, label=label)
    reference = results["bunny-references"]
    styles = reference_styles(curve["reference"]["codec"] for curve in reference["curves"])
    for (label, points), style in zip(reference_curves(reference).items(), styles, strict=True):
        axes.plot(*zip(*points, strict=True), **style, label=label)
    axes.plot(*zip(*PUBLISHED_RATES, strict=True), "k*", markersize=12, label="GSVR as published")
    _save(figure, axes, path)


def plot_times(results: dict[str, Json], path: Path) -> None:
    """Draw PSNR over the time of an encode of Bunny, ours and the publication's."""
    figure, axes = _axes("seconds a frame")
    rows = rows_of(results, "time") + rows_of(results, "slow")
    ours = [(row["seconds_per_frame"], row["psnr"]) for row in rows]
    axes.plot(*zip(*ours, strict=True), "o-", linewidth=2.5, label="ours, CPU")
    axes.plot(*zip(*PUBLISHED_TIMES, strict=True), "k*--", label="publication, RTX A6000")
    _save(figure, axes, path)


def _axes(xlabel: str) -> tuple[Figure, Axes]:
    figure = Figure(figsize=(9, 6), layout="constrained")
    axes = figure.subplots()
    axes.set(xscale="log", xlabel=xlabel, ylabel="mean RGB PSNR, dB")
    axes.grid(visible=True, which="both", linewidth=0.3)
    return figure, axes


def _save(figure: Figure, axes: Axes, path: Path) -> None:
    axes.legend(fontsize=8)
    # The same bytes each time, so that only what has changed shows as changed.
    with matplotlib.rc_context({"svg.hashsalt": "gsvrcodec", "svg.fonttype": "none"}):
        figure.savefig(path, metadata={"Date": None})
