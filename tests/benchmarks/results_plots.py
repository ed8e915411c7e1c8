"""The plots of the page of results. Needs matplotlib."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree

import matplotlib
import numpy as np
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

_SVG = "http://www.w3.org/2000/svg"


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
    titles = {}
    for number, line in enumerate(axes.get_lines()):
        line.set_gid(f"curve-{number}")
        points = np.asarray(line.get_xydata()).tolist()
        label = str(line.get_label())
        titles[f"curve-{number}"] = [f"{label}: {y:.2f} dB at {x:.4g}" for x, y in points]
    drawn = io.BytesIO()
    # The same bytes each time, so that only what has changed shows as changed.
    with matplotlib.rc_context({"svg.hashsalt": "gsvrcodec", "svg.fonttype": "none"}):
        figure.savefig(drawn, format="svg", metadata={"Date": None})
    path.write_bytes(titled(drawn.getvalue(), titles))


def titled(svg: bytes, titles: Mapping[str, Sequence[str]]) -> bytes:
    """Return a drawing of matplotlib whose markers say what they are when a mouse is over them.

    Args:
        svg: The drawing.
        titles: Of each marker, by the gid of its line.
    """
    for prefix, space in (("", _SVG), ("xlink", "http://www.w3.org/1999/xlink")):
        ElementTree.register_namespace(prefix, space)
    root = ElementTree.fromstring(svg)
    for gid, texts in titles.items():
        markers = root.findall(f".//*[@id='{gid}']//{{{_SVG}}}use")
        for marker, text in zip(markers, texts, strict=True):
            ElementTree.SubElement(marker, f"{{{_SVG}}}title").text = text
    return ElementTree.tostring(root, encoding="unicode").encode() + b"\n"
