"""gsvrdec: decode a .gsvr file to a video."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from fractions import Fraction
from typing import get_args

import click

from gsvrcodec.cli.command import Command
from gsvrcodec.cli.common import (
    EXIT_PARTIAL,
    about,
    device_option,
    may_overwrite,
    not_on_a_terminal,
    overwrite_option,
    quiet_option,
    run,
    threads_option,
    version_option,
)
from gsvrcodec.cli.values import rate, seconds, size
from gsvrcodec.errors import CorruptError
from gsvrcodec.model.layers import Layers
from gsvrcodec.video.output import DEFAULT_CRF

_MUXERS = ("mp4", "mkv", "y4m", "png", "md5", "null")
_FASTER = ("ultrafast", "superfast", "veryfast", "faster", "fast")
_SLOWER = ("medium", "slow", "slower", "veryslow", "placebo")

_GROUPS = {
    "Part of the film": ("start_frame", "frames", "start_seconds", "stop_seconds"),
    "Pictures": ("fps", "speed", "size", "scale", "layers", "bit_depth"),
    "Output": ("overwrite", "muxer", "crf", "codec_preset"),
    "General": ("keep_going", "threads", "device", "quiet", "version", "help"),
}


def main(args: Sequence[str] | None = None) -> int:
    """Run gsvrdec and return its exit code."""
    return run(command, args)


@click.command("gsvrdec", cls=Command, groups=_GROUPS, context_settings={"max_content_width": 100})
@click.argument("source", metavar="INPUT.gsvr")
@click.argument("target", metavar="[OUTPUT]", required=False)
@click.option(
    "--start-frame",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    metavar="N",
    help="First frame to write, from 0.",
)
@click.option(
    "--frames",
    type=click.IntRange(min=1),
    metavar="N",
    help="Number of frames to write; by default to the end.",
)
@click.option(
    "--ss",
    "start_seconds",
    type=seconds,
    metavar="TIME",
    help="Write frames that start at this time or later: seconds, or [HH:]MM:SS, on the clock of "
    "the video's timestamps.",
)
@click.option(
    "--to",
    "stop_seconds",
    type=seconds,
    metavar="TIME",
    help="Write frames that start before this time.",
)
@click.option(
    "--fps",
    type=rate,
    metavar="RATE",
    help="Constant frame rate, such as 60 or 60000/1001; frames are rendered at their own times.",
)
@click.option(
    "--speed",
    type=rate,
    default="1",
    show_default=True,
    metavar="FACTOR",
    help="0.25 = slow motion, four times as long; without --fps at the mean frame rate.",
)
@click.option(
    "--size",
    type=size,
    metavar="WxH",
    help="Render at this size, pixels; a side of -1 keeps the aspect ratio, -2 also makes it even.",
)
@click.option(
    "--scale", type=float, metavar="FACTOR", help="Render at this multiple of the coded size."
)
@click.option(
    "--layers",
    type=click.Choice(get_args(Layers)),
    default="all",
    show_default=True,
    help="Draw only Gaussians that move against the median motion (dynamic), or all others.",
)
@click.option(
    "--bit-depth",
    type=click.Choice(["auto", "8", "10"]),
    default="auto",
    show_default=True,
    help="Bits a sample; auto = 10 in .mp4 (then HEVC), .mkv and .y4m if the source had more "
    "than 8.",
)
@overwrite_option
@click.option(
    "--muxer",
    type=click.Choice(_MUXERS),
    help="Format of the output; by default from its name. md5 prints the MD5 of all RGB bytes, "
    "null writes nothing.",
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
    metavar="NAME",
    help="Effort of x264 or x265 for .mp4, ultrafast to placebo; by default veryfast, for 10 bits "
    "ultrafast.",
)
@click.option(
    "--keep-going",
    is_flag=True,
    help=f"Decode the intact part of a damaged file; exit code {EXIT_PARTIAL} if frames are lost.",
)
@threads_option
@device_option
@quiet_option
@version_option
def command(
    source: str,
    target: str | None,
    overwrite: bool,
    quiet: bool,
    muxer: str | None,
    start_frame: int,
    frames: int | None,
    start_seconds: Fraction | None,
    stop_seconds: Fraction | None,
    fps: Fraction | None,
    speed: Fraction,
    size: tuple[int, int] | None,
    scale: float | None,
    layers: Layers,
    bit_depth: str,
    keep_going: bool,
    crf: int,
    codec_preset: str | None,
    threads: int,
    device: str,
) -> int:
    """Decode a .gsvr file to a video: the stored frames, or frames at another rate and size.

    INPUT may be - for the standard input, which is decoded as it comes, or a URL. OUTPUT is .mp4
    (H.264, or HEVC for 10 bits; near-lossless), .mkv (FFV1, lossless), .y4m, a
    numbered picture such as out_%04d.png, or - for Y4M on the standard output.

    \b
    gsvrdec out.gsvr out.mp4
    gsvrdec --ss 1:30 --to 1:32.5 out.gsvr part_%04d.png
    gsvrdec --fps 60 --speed 0.25 --scale 2 out.gsvr slow.mp4
    gsvrdec out.gsvr - | ffmpeg -i - -c:v libx265 out.mkv
    gsvrdec --muxer md5 out.gsvr
    """
    from gsvrcodec.bitstream.source import path_of
    from gsvrcodec.cli.progress import FrameDisplay
    from gsvrcodec.decoder.export import decode
    from gsvrcodec.files import check_input

    if target is None and muxer not in ("md5", "null"):
        raise click.UsageError("name an output, or - for the standard output")
    if muxer not in ("md5", "null"):
        not_on_a_terminal(target)
    if size is not None and scale is not None:
        raise click.UsageError("give --size or --scale, not both")
    if (path := path_of(source)) is not None:
        check_input(path)
    overwrite = may_overwrite(target, overwrite)
    with about(source), _keep_going_hint(keep_going), FrameDisplay(quiet=quiet) as display:
        result = decode(
            source,
            target,
            muxer=muxer,
            start_frame=start_frame,
            frames=frames,
            start_seconds=start_seconds,
            stop_seconds=stop_seconds,
            fps=fps,
            speed=speed,
            size=scale if size is None else size,
            layers=layers,
            bit_depth=None if bit_depth == "auto" else int(bit_depth),
            overwrite=overwrite,
            keep_going=keep_going,
            crf=crf,
            codec_preset=codec_preset,
            threads=threads,
            device=device,
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


@contextmanager
def _keep_going_hint(keep_going: bool) -> Iterator[None]:
    """Say in an error about a damaged chunk that the rest may be decoded."""
    try:
        yield
    except CorruptError as error:
        if error.chunk is not None and not keep_going:
            error.add_note("`keep_going=True` decodes what is intact")
        raise
