"""gsvrenc: any video in, a .gsvr file out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, get_args

import click

from gsvrcodec.cli.common import (
    may_overwrite,
    overwrite_option,
    quiet_option,
    run,
    threads_option,
    version_option,
)
from gsvrcodec.cli.values import count, crop, gop_length
from gsvrcodec.fit.settings import Deform, EncodeSettings, Flow, Pack, Preset, Profile

_DEFAULTS = EncodeSettings()


def main(args: Sequence[str] | None = None) -> int:
    """Run gsvrenc and return its exit code."""
    return run(command, args)


@click.command("gsvrenc", context_settings={"max_content_width": 100, "show_default": True})
@click.argument("source", metavar="INPUT")
@click.argument("target", metavar="OUTPUT.gsvr")
@overwrite_option
@quiet_option
@click.option(
    "--preset",
    type=click.Choice(get_args(Preset)),
    default=_DEFAULTS.preset,
    help="How long to optimise.",
)
@click.option(
    "--time-budget",
    type=float,
    metavar="SECONDS",
    help="Seconds a frame for the whole encode, instead of a preset.",
)
@click.option(
    "--params",
    type=count,
    metavar="N",
    help="Numbers to store in the whole file, such as 3M; sets the size.",
)
@click.option(
    "--gaussians", type=count, metavar="N", help="Gaussians in each GOP, instead of --params."
)
@click.option(
    "--crop",
    type=crop,
    metavar="W:H[:X:Y]",
    help="Code a part of the picture; centred without a position.",
)
@click.option(
    "--start-frame",
    type=click.IntRange(min=0),
    default=_DEFAULTS.start_frame,
    metavar="N",
    help="First frame to encode, from 0.",
)
@click.option(
    "--frames", type=click.IntRange(min=1), metavar="N", help="How many frames; all without it."
)
@click.option(
    "--gop",
    type=gop_length,
    default=str(_DEFAULTS.gop),
    metavar="adaptive|N",
    help="Cut by motion, or every N frames.",
)
@click.option(
    "--gop-min",
    type=click.IntRange(min=1),
    default=_DEFAULTS.gop_min,
    metavar="N",
    help="Shortest adaptive GOP, frames.",
)
@click.option(
    "--gop-max",
    type=click.IntRange(min=1),
    default=_DEFAULTS.gop_max,
    metavar="N",
    help="Longest adaptive GOP, frames.",
)
@click.option(
    "--profile",
    type=click.Choice(get_args(Profile)),
    default=_DEFAULTS.profile,
    help="Ours, or the publication as it stands.",
)
@click.option(
    "--deform",
    type=click.Choice(get_args(Deform)),
    default=_DEFAULTS.deform,
    help="Parts of the deformation field in use.",
)
@click.option(
    "--flow",
    type=click.Choice(get_args(Flow)),
    default=_DEFAULTS.flow,
    help="Optical flow for slicing and the start; raft needs torchvision.",
)
@click.option(
    "--qat/--no-qat", default=_DEFAULTS.qat, help="Fine-tune under the quantisation to come."
)
@click.option(
    "--pack",
    type=click.Choice(get_args(Pack)),
    default=_DEFAULTS.pack,
    help="Codec of the parameter planes; auto = the smallest for each.",
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=_DEFAULTS.seed,
    metavar="N",
    help="Of every random choice; one seed, one file.",
)
@threads_option
@version_option
def command(source: str, target: str, overwrite: bool, quiet: bool, **settings: Any) -> None:
    """Encode a video as a .gsvr file.

    \b
    gsvrenc in.mp4 out.gsvr
    gsvrenc --preset fast --frames 100 in.mkv out.gsvr
    gsvrenc --params 3M --time-budget 2 --crop 1280:640 in.mp4 out.gsvr
    """
    from gsvrcodec.files import check_input, check_output
    from gsvrcodec.video.read import open_video

    # All that can be refused is refused before torch is loaded, which takes seconds.
    chosen = EncodeSettings(**settings)
    check_input(source)
    overwrite = may_overwrite(target, overwrite)
    check_output(target, overwrite=overwrite, source=source)
    open_video(source, chosen.crop, chosen.start_frame, chosen.frames).close()

    from gsvrcodec.cli.progress import EncodeDisplay, clock
    from gsvrcodec.encode import encode

    with EncodeDisplay(quiet=quiet) as display:
        result = encode(source, target, overwrite=overwrite, progress=display, **settings)
    if not quiet:
        click.echo(
            f"{result.path}: {result.frames} frames, {result.gops} GOPs, "
            f"{result.gaussians} Gaussians, {result.bytes} bytes, {result.bpp:.4f} bpp, "
            f"{result.psnr:.2f} dB, {clock(result.seconds)}",
            err=True,
        )
