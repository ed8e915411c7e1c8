"""Output of gsvrreport, at most 80 columns wide."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from gsvrcodec.report.compare import Report
    from gsvrcodec.report.quality import Quality
    from gsvrcodec.report.reference import Curve
    from gsvrcodec.report.study import Study

_WIDTH = 80


def print_study(study: Study) -> None:
    """Print the figures of one file as lines; of several files, or with references, as tables."""
    first = study.reports[0]
    size = f"{first.width}x{first.height}, {len(first.frames)} frames"
    if len(study.reports) == 1:
        click.echo(f"{size}, {first.bytes:,} bytes")
        click.echo(
            f"bpp         {first.bpp:.4f}\n"
            f"PSNR RGB    {first.psnr_rgb:.2f} dB mean of frames, "
            f"{first.psnr_rgb_pooled:.2f} dB pooled, {first.psnr_rgb_min:.2f} dB worst\n"
            f"SSIM        {_share(first.ssim)} of luma, MS-SSIM {_share(first.ms_ssim)}\n"
            f"decoding    {study.decode_fps[0]:.4g} frames a second"
        )
    else:
        click.echo(size)
    if len(study.reports) > 1 or study.curves:
        _print_points(study)
    if study.curves:
        click.echo(f"\n{study.machine}; {study.libraries}")
        for curve in study.curves:
            _print_comparison(study, curve)


def _print_points(study: Study) -> None:
    """Print a table of the files, and a table of each reference's encodes."""
    ours = zip(study.reports, study.decode_fps, strict=True)
    _print_table(
        "GSVR",
        [
            (Path(report.file).name, *_figures(report.bpp, report), "-", f"{fps:.4g}")
            for report, fps in ours
        ],
    )
    for curve in study.curves:
        rows = [
            (
                f"CRF {point.crf}",
                *_figures(point.bpp, point.quality),
                f"{point.encode_fps:.4g}",
                f"{point.decode_fps:.4g}",
            )
            for point in curve.points
        ]
        _print_table(f"{curve.label}, {curve.version}" if curve.version else curve.label, rows)


def _print_table(title: str, rows: Iterable[tuple[str, ...]]) -> None:
    """Print rows below a title."""
    from rich import box
    from rich.console import Console
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, width=_WIDTH, show_edge=False)
    table.add_column("", ratio=1, no_wrap=True, overflow="ellipsis")
    for name in ("bpp", "PSNR", "worst", "SSIM", "MS-SSIM", "enc fps", "dec fps"):
        table.add_column(name, justify="right", no_wrap=True, min_width=6)
    for row in rows:
        table.add_row(*map(_printable, row))
    click.echo(f"\n{title}")
    Console(width=_WIDTH, markup=False, highlight=False).print(table)


def _print_comparison(study: Study, curve: Curve) -> None:
    """Print the rate of a reference at the PSNR of each file, and the BD-rate."""
    click.echo(f"against {curve.label}:")
    for report in study.reports:
        rate = curve.rate_curve.rate(report.psnr_rgb)
        text = f"  {report.psnr_rgb:.2f} dB takes {report.bpp:.4f} bpp"
        if rate is None:
            click.echo(f"{text}; the reference was not measured there")
        else:
            click.echo(f"{text}, {report.bpp / rate:.2f} times its {rate:.4f}")
    if len(study.reports) > 1:
        bd_rate = study.bd_rate(curve)
        if bd_rate is None:
            click.echo("  no BD-rate: the two curves have no PSNR in common")
        else:
            click.echo(
                f"  BD-rate {bd_rate.percent:+.1f} % from {bd_rate.low:.2f} "
                f"to {bd_rate.high:.2f} dB"
            )


def _figures(bpp: float, quality: Quality | Report) -> list[str]:
    """Return the cells of a row for rate and quality."""
    return [
        f"{bpp:.4f}",
        f"{quality.psnr_rgb:.2f}",
        f"{quality.psnr_rgb_min:.2f}",
        _share(quality.ssim),
        _share(quality.ms_ssim),
    ]


def _share(value: float | None) -> str:
    return "-" if value is None else f"{value:.4f}"


def _printable(text: str) -> str:
    """Return text with every unprintable character replaced by "?"."""
    return "".join(letter if letter.isprintable() else "?" for letter in text)
