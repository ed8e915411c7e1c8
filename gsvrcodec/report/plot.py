"""PSNR over the frames, as a picture. Needs matplotlib."""

from __future__ import annotations

import os
from pathlib import Path

from gsvrcodec.errors import UsageError
from gsvrcodec.report.compare import Report

FORMATS = (".png", ".svg", ".pdf")


def plot(report: Report, path: str | os.PathLike[str], *, format: str | None = None) -> None:
    """Draw the PSNR of every frame.

    Args:
        report: what to draw.
        path: the file to write.
        format: "png", "svg" or "pdf"; None = by the suffix of `path`.

    Raises:
        UsageError: matplotlib is not installed, or the format is another.
    """
    format = format or Path(path).suffix.lower().removeprefix(".")
    if f".{format}" not in FORMATS:
        raise UsageError(f"{path}: a plot is written as {', '.join(FORMATS)}")
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise UsageError("plots need matplotlib: pip install 'gsvrcodec[plot]'") from error
    figure = Figure(figsize=(8, 4), layout="constrained")
    axes = figure.add_subplot()
    axes.plot([frame.frame for frame in report.frames], [f.psnr_rgb for f in report.frames])
    axes.axhline(report.psnr_rgb, linestyle="--", linewidth=1)
    axes.set(
        xlabel="frame",
        ylabel="RGB PSNR, dB",
        title=f"{Path(report.file).name}: mean {report.psnr_rgb:.2f} dB at {report.bpp:.4f} bpp",
    )
    figure.savefig(path, format=format)
