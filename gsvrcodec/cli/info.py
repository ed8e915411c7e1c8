"""gsvrinfo: show and verify the content of a .gsvr file."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import click

from gsvrcodec.cli.command import Command
from gsvrcodec.cli.common import (
    EXIT_CORRUPT,
    EXIT_MISMATCH,
    about,
    counted,
    may_overwrite,
    overwrite_option,
    run,
    version_option,
    write_text,
)
from gsvrcodec.errors import CorruptError

if TYPE_CHECKING:
    from gsvrcodec.report.inspect import FileInfo
    from gsvrcodec.report.spending import Item

#: Names of common CICP matrices; other matrices are shown as numbers.
_MATRICES = {0: "RGB", 1: "BT.709", 2: "untagged", 5: "BT.601", 6: "BT.601", 9: "BT.2020"}


def main(args: Sequence[str] | None = None) -> int:
    """Run gsvrinfo and return its exit code."""
    return run(command, args)


@click.command("gsvrinfo", cls=Command, context_settings={"max_content_width": 100})
@click.argument("source", metavar="INPUT.gsvr")
@click.option(
    "--json",
    "json_path",
    metavar="[FILE]",
    is_flag=False,
    flag_value="-",
    help="Write all properties as a JSON object; - or no FILE = standard output.",
)
@click.option("--gops", is_flag=True, help="List every GOP.")
@click.option("--bits", is_flag=True, help="List the bytes by purpose and attribute.")
@click.option(
    "--verify",
    is_flag=True,
    help="Check every rule of the format that needs no rendering; exit code "
    f"{EXIT_CORRUPT} if the file breaks one, {EXIT_MISMATCH} if its header and content differ.",
)
@overwrite_option
@version_option
def command(
    source: str, json_path: str | None, gops: bool, bits: bool, verify: bool, overwrite: bool
) -> int:
    """Show the content of a .gsvr file; - for the standard input, or a URL.

    \b
    gsvrinfo out.gsvr
    gsvrinfo --bits out.gsvr
    gsvrinfo --verify out.gsvr
    gsvrinfo out.gsvr --json | jq .bpp
    """
    from gsvrcodec.report.inspect import inspect, inspect_bytes
    from gsvrcodec.report.inspect import verify as faults_of

    overwrite = may_overwrite(json_path, overwrite)
    # What is read more than once.
    content = sys.stdin.buffer.read() if source == "-" else source
    with about(source):
        faults = list(faults_of(content)) if verify else []
        for fault in faults:
            click.echo(f"gsvrinfo: error: {source}: {fault}", err=True)
        try:
            info = inspect(content)
        except CorruptError:
            if not faults:
                raise
            return EXIT_CORRUPT
        items = inspect_bytes(content) if bits or json_path is not None else ()
    if json_path != "-":
        click.echo("\n".join(_lines(info)))
        if gops:
            click.echo("\n".join(_gop_lines(info)))
        if bits:
            click.echo("\n".join(_item_lines(items)))
    if json_path is not None:
        properties = info.to_dict() | {"spending": {item.name: item.to_dict() for item in items}}
        text = json.dumps(properties, indent=2, ensure_ascii=False) + "\n"
        write_text(json_path, text, overwrite=overwrite)
    if faults:
        return EXIT_CORRUPT
    for warning in info.warnings:
        click.echo(f"gsvrinfo: warning: {warning}", err=True)
    if not verify:
        return 0
    if info.warnings:
        return EXIT_MISMATCH
    frames, count = info.metadata.frames, info.metadata.gops
    click.echo(
        f"verified: {counted(frames, 'frame')} in {counted(count, 'GOP')}, all sound", err=True
    )
    return 0


def _lines(info: FileInfo) -> Iterator[str]:
    """Yield the properties of the file, at most 80 columns wide."""
    meta, colour = info.metadata, info.metadata.colour
    matrix = _MATRICES.get(colour.matrix, f"matrix {colour.matrix}")
    levels = "full" if colour.full_range else "limited"
    picture = f"{meta.width}x{meta.height}, {meta.bit_depth} bit, {matrix} {levels} range"
    if meta.sample_aspect != 1:
        picture += f", pixels {meta.sample_aspect.numerator}:{meta.sample_aspect.denominator}"
    if meta.mirrored:
        picture += ", shown mirrored"
    if meta.rotation:
        picture += f", shown turned by {meta.rotation} degrees"
    size = f"{meta.size_bytes:,} bytes, {meta.bpp:.4f} bpp"
    if meta.streams_bytes:
        size += f" without {meta.streams_bytes:,} bytes of copied streams"
    rows = {
        "file": info.path,
        "version": meta.version
        + ", pictures are sums" * (info.blending == "sum")
        + ", planes as PNG or JPEG XL" * info.image_codecs
        + ", plates" * info.plates
        + ", written as a stream" * info.stream,
        "picture": picture,
        "frames": f"{meta.frames:,} at {float(meta.average_rate):.5g} a second",
        "time": f"{float(meta.duration_seconds):.6g} s from {float(meta.begin_seconds):.6g} s, "
        f"ticks of {meta.time_base} s",
        "GOPs": f"{meta.gops:,}, {info.key_gops:,} of them key GOPs",
        "Gaussians": f"{meta.gaussians:,}, {info.carried:,} of them carried over",
        "parameters": f"{info.parameters:,}",
        "size": size,
    }
    settings = [f"{key} {value}" for key, value in meta.settings.items() if value is not None]
    if settings:
        rows["settings"] = ", ".join(settings)
    for label, text in rows.items():
        yield from _wrapped(f"{label:<11}", text)


def _wrapped(label: str, text: str) -> Iterator[str]:
    """Yield a label and its text, wrapped, with continuation lines below the text."""
    from textwrap import wrap

    printable = "".join(letter if letter.isprintable() else "?" for letter in text)
    lines = wrap(printable, 80 - len(label), break_long_words=False, break_on_hyphens=False)
    for number, line in enumerate(lines or [""]):
        yield (label if number == 0 else " " * len(label)) + line


def _gop_lines(info: FileInfo) -> Iterator[str]:
    """Yield a table of the GOPs."""
    base = info.metadata.time_base
    yield ""
    yield " frame frames  start s   from  carried changed   moved     new     grid    bytes"
    for gop in info.gops:
        grid = "x".join(map(str, gop.grid)) if any(gop.grid) else "-"
        is_key = gop.reference_frame is None
        carried = (gop.carried, gop.changed, gop.moved)
        counts = ["-" if is_key else f"{count:,}" for count in carried]
        yield (
            f"{gop.first_frame:>6}{gop.frames:>7}{float(gop.start_pts * base):>9.3f}"
            f"{'key' if is_key else str(gop.reference_frame):>7}"
            f"{counts[0]:>9}{counts[1]:>8}{counts[2]:>8}{gop.new:>8,}{grid:>9}{gop.bytes:>9,}"
        )


def _item_lines(items: Sequence[Item]) -> Iterator[str]:
    """Yield a table of the bytes by purpose."""
    total = sum(item.bytes for item in items)
    yield ""
    yield "spent on                bytes   share  bits a Gaussian  codecs"
    for item in items:
        row = _item_row(item.name, item.bytes, total, item.bits_per_gaussian)
        yield f"{row}  {', '.join(item.codecs)}".rstrip()
    known = [item.bits_per_gaussian for item in items if item.bits_per_gaussian is not None]
    yield _item_row("all", total, total, sum(known) if known else None)


def _item_row(name: str, size: int, total: int, bits: float | None) -> str:
    """Return one row of the table without the codecs."""
    cell = "-" if bits is None else f"{bits:.2f}"
    return f"{name:<17}{size:>12,}{size / total:>8.1%}{cell:>17}"
