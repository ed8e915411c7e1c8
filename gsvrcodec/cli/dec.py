"""gsvrdec: a .gsvr file in, a video out."""

from __future__ import annotations

from collections.abc import Sequence

import click

from gsvrcodec.cli.common import (
    EXIT_PARTIAL,
    about,
    may_overwrite,
    overwrite_option,
    quiet_option,
    run,
    threads_option,
    version_option,
)
from gsvrcodec.video.output import DEFAULT_CODEC_PRESET, DEFAULT_CRF

_MUXERS = ("mp4", "mkv", "y4m", "png", "md5", "null")
_FASTER = ("ultrafast", "superfast", "veryfast", "faster", "fast")
_SLOWER = ("medium", "slow", "slower", "veryslow", "placebo")


def main(args: Sequence[str] | None = None) -> int:
    """Run gsvrdec and return its exit code."""
    return run(command, args)


@click.command("gsvrdec", context_settings={"max_content_width": 100})
@click.argument("source", metavar="INPUT.gsvr")
@click.argument("target", metavar="[OUTPUT]", required=False)
@overwrite_option
@quiet_option
@click.option(
    "--muxer",
    type=click.Choice(_MUXERS),
    help="Format of the output, instead of by its name; md5 prints the sum of all RGB bytes, "
    "null writes nothing.",
)
@click.option(
    "--start-frame",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    metavar="N",
    help="First frame to write, from 0.",
)
@click.option(
    "--frames", type=click.IntRange(min=1), metavar="N", help="How many frames; all without it."
)
@click.option(
    "--keep-going",
    is_flag=True,
    help=f"Decode what is left of a damaged file; returns {EXIT_PARTIAL} if something is lost.",
)
@click.option(
    "--crf",
    type=click.IntRange(0, 51),
    default=DEFAULT_CRF,
    show_default=True,
    metavar="N",
    help="Quality of .mp4, 0 (best) to 51.",
)
@click.option(
    "--codec-preset",
    type=click.Choice([*_FASTER, *_SLOWER]),
    default=DEFAULT_CODEC_PRESET,
    show_default=True,
    metavar="NAME",
    help="x264's effort for .mp4, ultrafast to placebo.",
)
@threads_option
@version_option
def command(
    source: str,
    target: str | None,
    overwrite: bool,
    quiet: bool,
    muxer: str | None,
    start_frame: int,
    frames: int | None,
    keep_going: bool,
    crf: int,
    codec_preset: str,
    threads: int,
) -> int:
    """Decode a .gsvr file to a video with the original timestamps.

    OUTPUT is .mp4 (H.264, near-lossless), .mkv (FFV1, lossless), .y4m, a numbered picture such as
    out_%04d.png, or - for Y4M on the standard output.

    \b
    gsvrdec out.gsvr out.mp4
    gsvrdec --start-frame 100 --frames 24 out.gsvr part_%04d.png
    gsvrdec out.gsvr - | ffplay -
    gsvrdec --muxer md5 out.gsvr
    """
    from gsvrcodec.cli.progress import FrameDisplay
    from gsvrcodec.files import check_input
    from gsvrcodec.transcode import decode

    if target is None and muxer not in ("md5", "null"):
        raise click.UsageError("name an output, or - for the standard output")
    check_input(source)
    overwrite = may_overwrite(target, overwrite)
    with about(source), FrameDisplay(quiet=quiet) as display:
        result = decode(
            source,
            target,
            muxer=muxer,
            start_frame=start_frame,
            frames=frames,
            overwrite=overwrite,
            keep_going=keep_going,
            crf=crf,
            codec_preset=codec_preset,
            threads=threads,
            progress=display,
        )
    display.summary(result.frames)
    if result.complete:
        return 0
    click.echo(
        f"gsvrdec: warning: {source} is damaged: {result.frames} frames were written, "
        f"{result.lost_frames} lost",
        err=True,
    )
    return EXIT_PARTIAL
