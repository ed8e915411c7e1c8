"""gsvrreport: rate and distortion of .gsvr files, against their source."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from gsvrcodec.cli.command import Command
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
from gsvrcodec.cli.tables import print_study
from gsvrcodec.cli.values import crop as crop_value
from gsvrcodec.cli.values import references

if TYPE_CHECKING:
    from gsvrcodec.report.reference import Reference


def main(args: Sequence[str] | None = None) -> int:
    """Run gsvrreport and return its exit code."""
    return run(command, args)


@click.command("gsvrreport", cls=Command, context_settings={"max_content_width": 100})
@click.argument("source", metavar="SOURCE")
@click.argument("coded", metavar="INPUT.gsvr ...", nargs=-1, required=True)
@click.option(
    "--against",
    type=references,
    default="",
    metavar="NAMES",
    help="Also encode the source with x264, x265, svtav1, separated by commas; a name may be "
    "followed by :key=N, :key=same, :intra, :preset=NAME, :tune=NAME or :input=rgb.",
)
@click.option(
    "--json", "json_path", metavar="FILE", help="Write the report as JSON; - = standard output."
)
@click.option(
    "--csv",
    "csv_path",
    metavar="FILE",
    help="Write one line a frame as CSV, for a single file; - = standard output.",
)
@click.option(
    "--plot",
    "plot_path",
    metavar="FILE",
    help="Plot PSNR over frames, and over rate if there is more than one point, as .png, .svg "
    "or .pdf.",
)
@click.option(
    "--crop",
    type=crop_value,
    metavar="W:H[:X:Y]",
    help="Part of the source that was encoded, if the file does not record it.",
)
@click.option(
    "--start-frame",
    type=click.IntRange(min=0),
    metavar="N",
    help="First frame of the source that was encoded, if the file does not record it.",
)
@overwrite_option
@quiet_option
@threads_option
@version_option
def command(
    source: str,
    coded: tuple[str, ...],
    against: list[Reference],
    json_path: str | None,
    csv_path: str | None,
    plot_path: str | None,
    crop: tuple[int, int, int | None, int | None] | None,
    start_frame: int | None,
    overwrite: bool,
    quiet: bool,
    threads: int,
) -> None:
    """Compare .gsvr files with their source video, and with other encoders.

    \b
    gsvrreport in.mp4 out.gsvr
    gsvrreport in.mp4 out.gsvr --json report.json --csv frames.csv
    gsvrreport in.mp4 a.gsvr b.gsvr --against x264,svtav1 --plot rd.png
    """
    from gsvrcodec.bitstream.chunk import SIGNATURE
    from gsvrcodec.cli.progress import FrameDisplay
    from gsvrcodec.files import check_input, check_output
    from gsvrcodec.report.study import study

    if json_path == csv_path == "-":
        raise click.UsageError("--json and --csv cannot both go to the standard output")
    if csv_path is not None and len(coded) > 1:
        raise click.UsageError("--csv is for one file; give one, or use --json")
    for path in (source, *coded):
        check_input(path)
    with Path(source).open("rb") as file:
        if file.read(len(SIGNATURE)) == SIGNATURE:
            raise click.UsageError("the source comes first: gsvrreport in.mp4 out.gsvr")
    outputs = {path: False for path in (json_path, csv_path, plot_path) if path not in (None, "-")}
    for path in outputs:
        outputs[path] = may_overwrite(path, overwrite)
        for given in (source, *coded):
            check_output(str(path), overwrite=outputs[path], source=given)
    if plot_path is not None:
        from gsvrcodec.report.plot import check_plot, plot

        check_plot(plot_path)
    with FrameDisplay(quiet=quiet) as display:
        result = study(
            source,
            coded,
            against,
            crop=crop,
            start_frame=start_frame,
            threads=threads,
            progress=display,
            about=about,
        )
    if not quiet and "-" not in (json_path, csv_path):
        print_study(result)
    if json_path is not None:
        write_text(json_path, result.to_json(), overwrite=outputs.get(json_path, False))
    if csv_path is not None:
        text = result.reports[0].to_csv()
        write_text(csv_path, text, overwrite=outputs.get(csv_path, False))
    if plot_path is not None:
        from gsvrcodec.files import atomic_output

        suffix = Path(plot_path).suffix.lower().removeprefix(".")
        with atomic_output(plot_path, overwrite=outputs[plot_path]) as partial:
            plot(result, partial, format=suffix)
