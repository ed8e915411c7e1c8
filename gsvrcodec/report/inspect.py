"""Inspection and verification of a .gsvr file; nothing is rendered."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from gsvrcodec.bitstream.background_payload import unpack_background
from gsvrcodec.bitstream.chunk import BACKGROUND_TYPE, ChunkEntry
from gsvrcodec.bitstream.gop_head import GOP_HEAD_BYTES, GopEntry, GopHead, parse_gop_head
from gsvrcodec.bitstream.gop_payload import unpack_gop
from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.decoder.frames import Metadata
from gsvrcodec.errors import CorruptError
from gsvrcodec.limits import Limits
from gsvrcodec.model.attributes import ATTRIBUTES, STATIC_ATTRIBUTES, Attribute, GopShape
from gsvrcodec.model.background import Background, check_shown
from gsvrcodec.report.spending import Item, spending


@dataclass(frozen=True, slots=True, kw_only=True)
class GopInfo:
    """Properties of one GOP."""

    first_frame: int  #: number of the first frame
    frames: int  #: frames in the GOP
    start_pts: int  #: presentation timestamp of the first frame, ticks
    last_pts: int  #: presentation timestamp of the last frame, ticks
    gaussians: int  #: Gaussians of the GOP, without its background
    background: int  #: number of the background that the GOP shows; 0 = none
    grid: tuple[int, int, int]  #: Gx, Gy, Gt of the tri-plane; all 0 = no tri-plane
    parameters: int  #: stored numbers, before quantisation
    bytes: int  #: size of the payload


@dataclass(frozen=True, slots=True, kw_only=True)
class BackgroundInfo:
    """Properties of one background."""

    number: int  #: number by which GOPs refer to the background
    gaussians: int  #: Gaussians in the background
    parameters: int  #: stored numbers, before quantisation
    bytes: int  #: size of the payload


@dataclass(frozen=True, slots=True)
class FileInfo:
    """Properties of a .gsvr file."""

    path: str
    metadata: Metadata
    gops: tuple[GopInfo, ...]
    backgrounds: tuple[BackgroundInfo, ...]
    recovered: bool  #: whether the file has no valid index: it is cut short or damaged
    warnings: tuple[str, ...]  #: faults that do not prevent decoding

    @property
    def parameters(self) -> int:
        """Parameters of all GOPs and backgrounds, before quantisation."""
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
    """Return the properties of a file, from its header, its index and the heads of its GOPs.

    Raises:
        InputError: The file cannot be read.
        CorruptError: The file is not a .gsvr file, or no GOP is whole.
        UnsupportedError: The file needs a feature that this version does not have, or is over
            `limits`.
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
    """Return the bytes of a file by purpose; reads the whole file. Raises as `inspect`."""
    with GsvrReader(path, limits) as reader:
        return spending(reader, limits)


def verify(path: str | os.PathLike[str], *, limits: Limits | None = None) -> Iterator[str]:
    """Check every checksum of a file and decode every plane; yield one sentence a fault.

    Raises:
        InputError, CorruptError, UnsupportedError: As `inspect`, if the file cannot be opened.
    """
    limits = limits or Limits.from_environment()
    with GsvrReader(path, limits) as reader:
        if reader.recovered:
            yield from reader.warnings
        gops = {entry.offset: position for position, entry in enumerate(reader.gops)}
        backgrounds: dict[int, tuple[ChunkEntry, Background]] = {}
        for chunk in reader.chunks:
            place = chunk
            try:
                if chunk.offset in gops:
                    payload = reader.read_gop(gops[chunk.offset])
                    content = unpack_gop(payload, reader.header, limits)
                    if content.shown is not None:
                        if content.background not in backgrounds:
                            raise CorruptError(f"background {content.background} is lost")
                        place, background = backgrounds[content.background]
                        check_shown(background, content.shown)
                elif chunk.type == BACKGROUND_TYPE:
                    background = unpack_background(reader.read_chunk(chunk), limits)
                    backgrounds[background.number] = chunk, background
                else:
                    reader.read_chunk(chunk)
            except CorruptError as error:
                yield str(error.located(place.name, place.offset))


def _gop_info(entry: GopEntry, head: GopHead) -> GopInfo:
    """Return the properties of a GOP from its index entry and its head."""
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
    """Return the number of parameters, equal to `Gop.parameters` of the decoded GOP."""
    return sum(a.components * shape.samples(a.grid) for a in attributes)
