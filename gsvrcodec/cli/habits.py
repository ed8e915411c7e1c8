"""Hints for options that people know from FFmpeg and its relatives."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import click

#: What to write instead of an option, by the name of a command ("" = of all).
_HINTS = {
    "": {
        "-i": "the input is named without -i: {usage}",
        "-hide_banner": "there is no banner: leave it out",
        "-loglevel": "-q prints errors and warnings only",
        "-v": "-q prints errors and warnings only",
        "-n": "an existing output is never overwritten without -y: leave it out",
        "-o": "the output is named without -o: {usage}",
        "-version": "write --version",
    },
    "gsvrenc": {
        "-c": "there is one codec: leave it out",
        "-vcodec": "there is one codec: leave it out",
        "-b": "write --bitrate",
        "-r": "write --rate for numbered pictures; films keep their frame rate",
        "-t": "write --to, the time at which to stop, or --frames",
        "-s": "--crop takes a part of the picture; scale it with ffmpeg, see --help",
        "-vf": "--crop, --deinterlace and --ss do the most; for other filters pipe ffmpeg into "
        "gsvrenc, see --help",
        "-vframes": "write --frames",
        "-an": "write --no-audio",
        "-sn": "write --no-subtitles",
        "-g": "write --gop for the length of GOPs, --keyint for the time between key GOPs",
        "-q": "write --crf",
        "-qp": "write --crf",
        "-f": "the format is always GSVR: leave it out",
    },
    "gsvrdec": {
        "-c": "the name of the output chooses the codec, see --help",
        "-vcodec": "the name of the output chooses the codec, see --help",
        "-b": "write --crf",
        "-r": "write --fps",
        "-t": "write --to, the time at which to stop, or --frames",
        "-s": "write --size",
        "-vf": "--size, --fps and --layers do the most; for filters pipe gsvrdec into ffmpeg, "
        "see --help",
        "-vframes": "write --frames",
        "-preset": "write --codec-preset",
        "-f": "write --muxer",
        "-pix_fmt": "write --bit-depth",
    },
}


def habit(name: str, args: Iterable[str], parameters: Sequence[click.Parameter]) -> str | None:
    """Return what to write instead of the first option of another program; None = there is none.

    Args:
        name: of the command.
        args: its arguments.
        parameters: that it has.
    """
    known = {each for parameter in parameters for each in parameter.opts}
    short = {option[1] for option in known if option[0] == "-" and len(option) == 2}
    for arg in args:
        if arg == "--":
            break
        if not arg.startswith("-") or arg.startswith("--") or set(arg[1:]) <= short:
            continue
        option = arg.split(":")[0].split("=")[0]
        hints = _HINTS[""] | _HINTS.get(name, {})
        if option in hints:
            return f"{option}: {hints[option]}"
        if f"-{option}" in known:
            return f"{option}: write -{option}"
    return None
