"""gsvrreport: what a .gsvr file costs and how close it comes to its source."""

from __future__ import annotations

from collections.abc import Sequence

import click

from gsvrcodec.cli.common import (
    about,
    may_overwrite,
    overwrite_option,
    quiet_option,
    run,
    threads_option,
    version_option,
    write_text,
)
from gsvrcodec.cli.values import crop as crop_value


def main(args: Sequence[str] | None = None) -> int:
    """Run gsvrreport and return its exit code."""
    return run(command, args)


@click.command("gsvrreport", context_settings={"max_content_width": 100})
@click.argument("source", metavar="SOURCE")
@click.argument("coded", metavar="INPUT.gsvr")
@click.option(
    "--json", "json_path", metavar="FILE", help="Write the report as JSON; - = standard output."
)
@click.option(
    "--csv", "csv_path", metavar="FILE", help="Write one line a frame; - = standard output."
)
@click.option(
    "--plot", "plot_path", metavar="FILE", help="Draw PSNR over frames as .png, .svg or .pdf."
)
@click.option(
    "--crop",
    type=crop_value,
    metavar="W:H[:X:Y]",
    help="Part of the source that was coded, if the file does not say.",
)
@click.option(
    "--start-frame",
    type=click.IntRange(min=0),
    metavar="N",
    help="First frame of the source that was coded, if the file does not say.",
)
@overwrite_option
@quiet_option
@threads_option
@version_option
def command(
    source: str,
    coded: str,
    json_path: str | None,
    csv_path: str | None,
    plot_path: str | None,
    crop: tuple[int, int, int | None, int | None] | None,
    start_frame: int | None,
    overwrite: bool,
    quiet: bool,
    threads: int,
) -> None:
    """Compare a .gsvr file with the video it was made from.

    \b
    gsvrreport in.mp4 out.gsvr
    gsvrreport in.mp4 out.gsvr --json report.json --csv frames.csv
    """
    from gsvrcodec.cli.progress import FrameDisplay
    from gsvrcodec.files import check_input, check_output
    from gsvrcodec.report.compare import report

    if json_path == csv_path == "-":
        raise click.UsageError("--json and --csv cannot both go to the standard output")
    check_input(source)
    check_input(coded)
    outputs = {path: False for path in (json_path, csv_path, plot_path) if path not in (None, "-")}
    for path in outputs:
        outputs[path] = may_overwrite(path, overwrite)
        check_output(str(path), overwrite=outputs[path], source=source)
        check_output(str(path), overwrite=outputs[path], source=coded)
    with about(coded), FrameDisplay(quiet=quiet) as display:
        result = report(
            source, coded, crop=crop, start_frame=start_frame, threads=threads, progress=display
        )
    if "-" not in (json_path, csv_path):
        click.echo(
            f"{result.width}x{result.height}, {len(result.frames)} frames, {result.bytes:,} bytes\n"
            f"bpp         {result.bpp:.4f}\n"
            f"PSNR RGB    {result.psnr_rgb:.2f} dB mean of frames, "
            f"{result.psnr_rgb_pooled:.2f} dB pooled, {result.psnr_rgb_min:.2f} dB worst"
        )
    if json_path is not None:
        write_text(json_path, result.to_json(), overwrite=outputs.get(json_path, False))
    if csv_path is not None:
        write_text(csv_path, result.to_csv(), overwrite=outputs.get(csv_path, False))
    if plot_path is not None:
        from pathlib import Path

        from gsvrcodec.files import atomic_output
        from gsvrcodec.report.plot import plot

        suffix = Path(plot_path).suffix.lower().removeprefix(".")
        with atomic_output(plot_path, overwrite=outputs[plot_path]) as partial:
            plot(result, partial, format=suffix)
