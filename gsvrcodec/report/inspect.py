"""What is in a .gsvr file, and whether all of it is sound; nothing is rendered."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from gsvrcodec.bitstream.background_payload import unpack_background
from gsvrcodec.bitstream.chunk import BACKGROUND_TYPE
from gsvrcodec.bitstream.gop_head import GOP_HEAD_BYTES, GopEntry, GopHead, parse_gop_head
from gsvrcodec.bitstream.gop_payload import unpack_gop
from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.decoder.frames import Metadata
from gsvrcodec.errors import CorruptError
from gsvrcodec.limits import Limits
from gsvrcodec.model.attributes import ATTRIBUTES, STATIC_ATTRIBUTES, Attribute, GopShape
from gsvrcodec.report.spending import Item, spending


@dataclass(frozen=True, slots=True, kw_only=True)
class GopInfo:
    """One GOP of a file."""

    first_frame: int  #: number of its first frame
    frames: int  #: how many it has
    start_pts: int  #: presentation time of its first frame, ticks
    last_pts: int  #: presentation time of its last frame, ticks
    gaussians: int  #: Gaussians of its own
    background: int  #: number of the background whose Gaussians it shows as well; 0 = none
    grid: tuple[int, int, int]  #: size of the tri-plane in x, y and time; 0 = none
    parameters: int  #: stored numbers, before quantisation
    bytes: int  #: of its payload


@dataclass(frozen=True, slots=True, kw_only=True)
class BackgroundInfo:
    """One background of a file."""

    number: int  #: by which GOPs name it
    gaussians: int  #: Gaussians in it
    parameters: int  #: stored numbers, before quantisation
    bytes: int  #: of its payload


@dataclass(frozen=True, slots=True)
class FileInfo:
    """A .gsvr file."""

    path: str
    metadata: Metadata
    gops: tuple[GopInfo, ...]
    backgrounds: tuple[BackgroundInfo, ...]
    recovered: bool  #: whether it is cut short or damaged, so that GOPs had to be searched for
    warnings: tuple[str, ...]  #: what is wrong with it and does not keep it from being decoded

    @property
    def parameters(self) -> int:
        """Stored numbers of all GOPs and backgrounds, before quantisation."""
        own = sum(gop.parameters for gop in self.gops)
        return own + sum(background.parameters for background in self.backgrounds)

    def to_dict(self) -> dict[str, Any]:
        """Return all of it as JSON can hold it."""
        meta = self.metadata
        return {
            "file": self.path,
            "version": meta.version,
            "width": meta.width,
            "height": meta.height,
            "frames": meta.frames,
            "gops": meta.gops,
            "gaussians": meta.gaussians,
            "parameters": self.parameters,
            "bytes": meta.size_bytes,
            "bpp": meta.bpp,
            "time_base": str(meta.time_base),
            "begin_seconds": float(meta.begin_seconds),
            "duration_seconds": float(meta.duration_seconds),
            "average_rate": float(meta.average_rate),
            "sample_aspect": str(meta.sample_aspect),
            "rotation": meta.rotation,
            "mirrored": meta.mirrored,
            "bit_depth": meta.bit_depth,
            "colour": asdict(meta.colour),
            "recovered": self.recovered,
            "warnings": list(self.warnings),
            "settings": meta.settings,
            "gop_list": [asdict(gop) for gop in self.gops],
            "background_list": [asdict(background) for background in self.backgrounds],
        }


def inspect(path: str | os.PathLike[str], *, limits: Limits | None = None) -> FileInfo:
    """Return what a file says of itself, from its header, its index and the heads of its GOPs.

    Raises:
        InputError: it cannot be read.
        CorruptError: it is not a .gsvr file, or no GOP of it is whole.
        UnsupportedError: it needs something this version does not have, or is over `limits`.
    """
    with GsvrReader(path, limits) as reader, Path(path).open("rb") as file:
        gops = []
        for entry in reader.gops:
            file.seek(entry.chunk.payload_offset)
            try:
                head = parse_gop_head(file.read(GOP_HEAD_BYTES))
            except CorruptError as error:
                raise error.located(entry.chunk.name, entry.offset) from error
            gops.append(_gop_info(entry, head))
        backgrounds = tuple(
            BackgroundInfo(
                number=background.number,
                gaussians=background.gaussians,
                parameters=_parameters(
                    GopShape(background.gaussians, (0, 0, 0)), STATIC_ATTRIBUTES
                ),
                bytes=background.chunk.size,
            )
            for background in reader.backgrounds
        )
        return FileInfo(
            os.fspath(path),
            Metadata.of(reader),
            tuple(gops),
            backgrounds,
            reader.recovered,
            reader.warnings,
        )


def inspect_bytes(
    path: str | os.PathLike[str], *, limits: Limits | None = None
) -> tuple[Item, ...]:
    """Return what the bytes of a file are spent on; reads all of it. Raises as `inspect`."""
    with GsvrReader(path, limits) as reader:
        return spending(reader, limits)


def verify(path: str | os.PathLike[str], *, limits: Limits | None = None) -> Iterator[str]:
    """Check every checksum of a file and decode every plane; yield one sentence a fault.

    Raises:
        InputError, CorruptError, UnsupportedError: as `inspect`, when nothing of it can be read.
    """
    limits = limits or Limits.from_environment()
    with GsvrReader(path, limits) as reader:
        if reader.recovered:
            yield from reader.warnings
        gops = {entry.offset: position for position, entry in enumerate(reader.gops)}
        backgrounds: dict[int, int] = {}
        for chunk in reader.chunks:
            try:
                if chunk.offset in gops:
                    payload = reader.read_gop(gops[chunk.offset])
                    content = unpack_gop(payload, reader.header, limits)
                    expected = 0 if content.shown is None else len(content.shown)
                    if backgrounds.get(content.background, 0) != expected:
                        raise CorruptError(
                            f"background {content.background} is lost or another one"
                        )
                elif chunk.type == BACKGROUND_TYPE:
                    background = unpack_background(reader.read_chunk(chunk), limits)
                    backgrounds[background.number] = len(background.gop)
                else:
                    reader.read_chunk(chunk)
            except CorruptError as error:
                yield str(error.located(chunk.name, chunk.offset))


def _gop_info(entry: GopEntry, head: GopHead) -> GopInfo:
    """Return what index and head say of a GOP."""
    return GopInfo(
        first_frame=entry.first_frame,
        frames=entry.frames,
        start_pts=entry.start_pts,
        last_pts=entry.last_pts,
        gaussians=entry.gaussians,
        background=head.background,
        grid=head.grid,
        parameters=_parameters(GopShape(entry.gaussians, head.grid), ATTRIBUTES),
        bytes=entry.size,
    )


def _parameters(shape: GopShape, attributes: Sequence[Attribute]) -> int:
    """Return how many numbers are stored; the same as `Gop.parameters` of a GOP's content."""
    return sum(a.components * shape.samples(a.grid) for a in attributes)
