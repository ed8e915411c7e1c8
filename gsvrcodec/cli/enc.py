"""gsvrenc: encode a video as a .gsvr file."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import click

from gsvrcodec.cli.command import Command
from gsvrcodec.cli.common import (
    EXIT_MISMATCH,
    counted,
    device_option,
    may_overwrite,
    not_on_a_terminal,
    overwrite_option,
    quiet_option,
    run,
    threads_option,
    version_option,
    write_text,
)
from gsvrcodec.cli.progress import EncodeDisplay, EncodeJson, clock
from gsvrcodec.cli.values import count, crop, file_size, gop_length, rate, seconds
from gsvrcodec.encoder.settings import DEFAULT_CRF, EncodeSettings, Pack, Preset
from gsvrcodec.fit.recipe import Deform, Flow, Profile

if TYPE_CHECKING:
    from gsvrcodec.video import VideoReader

_DEFAULTS = EncodeSettings()

_GROUPS = {
    "Size and quality (at most one)": (
        *("crf", "params", "gaussians", "bpp", "bitrate", "target_size", "target_psnr"),
    ),
    "Effort": ("preset", "time_budget", "workers", "threads", "device"),
    "Cluster": ("cluster", "shared_source"),
    "Input": ("rate", "bake_rotation", "deinterlace"),
    "Part of the film": ("crop", "start_frame", "frames", "start_seconds", "stop_seconds"),
    "Sound and subtitles": ("audio", "subtitles"),
    "Output": ("overwrite", "resume", "verify", "stats", "progress", "quiet"),
    "Model": (
        *("gop", "gop_min", "gop_max", "keyint", "profile"),
        *("deform", "flow", "plates", "qat", "pack", "seed"),
    ),
    "General": ("version", "help"),
}


def main(args: Sequence[str] | None = None) -> int:
    """Run gsvrenc and return its exit code."""
    return run(command, args)


@click.command(
    "gsvrenc",
    cls=Command,
    groups=_GROUPS,
    context_settings={"max_content_width": 100, "show_default": True},
)
@click.argument("source", metavar="INPUT")
@click.argument("target", metavar="OUTPUT.gsvr")
@click.option(
    "--crf",
    type=float,
    metavar="N",
    help="Constant quality, 0 to 51, on about the scale of x264; more is smaller. "
    f"{DEFAULT_CRF:g} if no other of these is given.",
)
@click.option(
    "--params",
    type=count,
    metavar="N",
    help="Most parameters in the whole file, such as 3M; key GOPs only.",
)
@click.option("--gaussians", type=count, metavar="N", help="Gaussians in each GOP.")
@click.option(
    "--bpp", type=float, metavar="BITS", help="Bits a pixel and frame, without copied streams."
)
@click.option(
    "--bitrate",
    type=count,
    metavar="BITS",
    help="Bits a second, such as 1.5M, without copied streams.",
)
@click.option(
    "--target-size",
    type=file_size,
    metavar="BYTES",
    help="Bytes of the whole file, such as 10MB or 1.5MiB.",
)
@click.option(
    "--target-psnr", type=float, metavar="DB", help="Mean PSNR of all frames, such as 38."
)
@click.option(
    "--preset",
    type=click.Choice(get_args(Preset)),
    default=_DEFAULTS.preset,
    help="Optimisation effort.",
)
@click.option(
    "--time-budget",
    type=float,
    metavar="SECONDS",
    help="Wall time of the whole encode, seconds a frame; instead of a preset.",
)
@click.option(
    "--workers",
    type=click.IntRange(min=0),
    default=_DEFAULTS.workers,
    metavar="N",
    help="Worker processes, each encoding one chain of GOPs at a time; they share the threads. 0 = "
    "chosen by length of the encode. Does not change the file.",
)
@threads_option
@device_option
@click.option(
    "--cluster",
    metavar="ADDRESS",
    help="Fit on the workers of a Dask cluster: tcp://host:8786, a scheduler file NAME.json, or "
    "auto = the address in DASK_SCHEDULER_ADDRESS. Does not change the file.",
)
@click.option(
    "--shared-source",
    is_flag=True,
    help="The workers of the cluster read INPUT by themselves, at the same path as here; otherwise "
    "frames are sent to them.",
)
@click.option(
    "--crop",
    type=crop,
    metavar="W:H[:X:Y]",
    help="Encode a part of the picture; by default centred.",
)
@click.option(
    "--start-frame",
    type=click.IntRange(min=0),
    default=_DEFAULTS.start_frame,
    metavar="N",
    help="First frame to encode, from 0.",
)
@click.option(
    "--frames",
    type=click.IntRange(min=1),
    metavar="N",
    help="Number of frames to encode; by default to the end.",
)
@click.option(
    "--ss",
    "start_seconds",
    type=seconds,
    metavar="TIME",
    help="Encode frames that start at this time or later, such as 90.5 or 1:30.5.",
)
@click.option(
    "--to",
    "stop_seconds",
    type=seconds,
    metavar="TIME",
    help="Encode frames that start before this time.",
)
@click.option(
    "--rate",
    type=rate,
    metavar="R",
    help="Frame rate of numbered pictures and raw streams, such as 30 or 30000/1001.",
)
@click.option(
    "--bake-rotation",
    is_flag=True,
    help="Turn and mirror the pictures; by default the file tells the player to.",
)
@click.option("--deinterlace", is_flag=True, help="Deinterlace an interlaced source.")
@click.option("--audio/--no-audio", default=_DEFAULTS.audio, help="Copy the source's sound.")
@click.option(
    "--subtitles/--no-subtitles",
    default=_DEFAULTS.subtitles,
    help="Copy the source's subtitles.",
)
@click.option(
    "--gop",
    type=gop_length,
    default=str(_DEFAULTS.gop),
    metavar="adaptive|N",
    help="GOP length by motion, or N frames; a cut always starts a GOP.",
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
    help="Longest adaptive GOP, frames; by default 32 to 128, the longer the fewer bits.",
)
@click.option(
    "--keyint",
    type=float,
    default=_DEFAULTS.keyint,
    metavar="SECONDS",
    help="Longest time between key GOPs, which need no other GOP but the one with their plate; "
    "0 = key GOPs only, which need none.",
)
@click.option(
    "--profile",
    type=click.Choice(get_args(Profile)),
    default=_DEFAULTS.profile,
    help="main, or paper = the method as published.",
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
    help="Optical flow for GOP lengths and initial motion; raft needs torchvision.",
)
@click.option(
    "--plates/--no-plates",
    default=_DEFAULTS.plates,
    help="Store a still picture behind the Gaussians where that pays; not with --params or "
    "--gaussians.",
)
@click.option(
    "--qat/--no-qat",
    default=_DEFAULTS.qat,
    help="Fine-tune for quantisation: attributes are rounded in turn (staged quantisation).",
)
@click.option(
    "--pack",
    type=click.Choice(get_args(Pack)),
    default=_DEFAULTS.pack,
    help="Codecs of the parameter planes; auto = the smallest for each plane.",
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=_DEFAULTS.seed,
    metavar="N",
    help="Seed of all random choices; the same seed gives the same file.",
)
@overwrite_option
@click.option(
    "--resume",
    is_flag=True,
    help="Resume an interrupted encode from its checkpoint, if there is one; the file is the same "
    "as without interruption.",
)
@click.option(
    "--verify",
    is_flag=True,
    help="Decode the finished file and compare it with the source; exit code "
    f"{EXIT_MISMATCH} if they differ.",
)
@click.option(
    "--stats", metavar="FILE", help="Write statistics of each GOP as JSON; - = standard output."
)
@click.option(
    "--progress",
    type=click.Choice(["auto", "json", "none"]),
    default="auto",
    help="auto = a bar on a terminal, else lines; json = JSON lines on the standard output.",
)
@quiet_option
@version_option
def command(
    source: str,
    target: str,
    overwrite: bool,
    resume: bool,
    verify: bool,
    stats: str | None,
    progress: str,
    quiet: bool,
    cluster: str | None,
    shared_source: bool,
    **settings: Any,
) -> None:
    """Encode a video as a .gsvr file.

    INPUT is any file that FFmpeg reads, numbered pictures such as in_%04d.png, or - for the
    standard input. OUTPUT.gsvr appears when it is complete; - is the standard output. Until then
    finished GOPs are in the checkpoint OUTPUT.gsvr.part, for --resume.

    \b
    gsvrenc in.mp4 out.gsvr
    gsvrenc --preset fastest --frames 100 in.mkv out.gsvr
    gsvrenc --target-size 10MB --preset slow --verify in.mp4 out.gsvr
    ffmpeg -i in.mp4 -f yuv4mpegpipe - | gsvrenc - out.gsvr
    gsvrenc --params 3M --time-budget 2 --crop 1280:640 in.mp4 out.gsvr
    gsvrenc --resume --progress json in.mp4 out.gsvr | jq .psnr
    gsvrenc --cluster tcp://scheduler:8786 --shared-source /films/in.mp4 out.gsvr
    """
    from gsvrcodec.encoder.request import checked
    from gsvrcodec.files import check_output
    from gsvrcodec.video import is_pipe, open_video

    if [target, stats, "-" if progress == "json" else None].count("-") > 1:
        raise click.UsageError("only one thing can go to the standard output")
    not_on_a_terminal(target)
    if shared_source and cluster is None:
        raise click.UsageError("--shared-source is for the workers of a --cluster")
    # Options and paths are checked before the encoder is loaded.
    for name in ("start_seconds", "stop_seconds", "rate"):
        settings[name] = None if settings[name] is None else float(settings[name])
    chosen = EncodeSettings(**settings)
    if resume or not Path(f"{target}.part").exists():  # else -y alone discards it
        overwrite = may_overwrite(target, overwrite)
    request = checked(
        source,
        target,
        chosen,
        overwrite=overwrite,
        resume=resume,
        executor=cluster is not None,
        shared_source=shared_source,
    )
    overwrite_stats = may_overwrite(stats, overwrite)
    if stats is not None:
        check_output(stats, overwrite=overwrite_stats, source=source)
    as_json = EncodeJson() if progress == "json" else None
    shown = as_json or EncodeDisplay(quiet=quiet or progress == "none")
    if not is_pipe(source):
        with open_video(source, **request.reading) as video:
            if as_json is None and not (quiet or progress == "none"):
                click.echo(_described(source, video, chosen), err=True)

    with shown as display:
        display.loading()
        from gsvrcodec.encoder.encode import encode
        from gsvrcodec.encoder.run.dask import Cluster

        with nullcontext() if cluster is None else Cluster(cluster) as executor:
            result = encode(
                source,
                target,
                overwrite=overwrite,
                resume=resume,
                verify=verify,
                progress=display,
                executor=executor,
                shared_source=shared_source,
                **settings,
            )
    if stats is not None:
        content = {**result.to_dict(), "settings": chosen.recorded()}
        write_text(stats, json.dumps(content, indent=2) + "\n", overwrite=overwrite_stats)
    if as_json is not None:
        summary = result.to_dict()
        del summary["gop_stats"]
        as_json.done(summary)
    elif not quiet:
        click.echo(
            f"{result.path}: {counted(result.frames, 'frame')}, {result.bytes:,} bytes, "
            f"{result.bitrate / 1000:.4g} kbit/s, {result.bpp:.4f} bpp, {result.psnr:.2f} dB in "
            f"{clock(result.seconds)}{', verified' * verify}",
            err=True,
        )


def _described(source: str, video: VideoReader, settings: EncodeSettings) -> str:
    """Return what is known of a video before it is read, and about how long its encode takes."""
    info, frames = video.info, video.expected_frames
    parts = [f"{source}: {info.width}x{info.height}"]
    if info.average_rate is not None:
        parts.append(f"{float(info.average_rate):.4g} fps")
    parts.append(info.codec)
    if frames is not None:
        pace = settings.expected_pace(info.width * info.height, settings.workers)
        parts += [f"{frames} frames", f"about {clock(pace * frames)}"]
    return ", ".join(parts)
