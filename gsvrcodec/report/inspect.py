"""Inspection and verification of a .gsvr file; nothing is rendered."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from gsvrcodec.bitstream.chunk import GOP_TYPE
from gsvrcodec.bitstream.gop_chain import GopUnpacker
from gsvrcodec.bitstream.gop_head import GOP_HEAD_BYTES, GopEntry, GopHead, parse_gop_head
from gsvrcodec.bitstream.gop_payload import unpack_gop
from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.decoder.frames import Metadata
from gsvrcodec.errors import CorruptError
from gsvrcodec.limits import Limits
from gsvrcodec.model.attributes import ALL_ATTRIBUTES
from gsvrcodec.report.spending import Item, spending


@dataclass(frozen=True, slots=True, kw_only=True)
class GopInfo:
    """Properties of one GOP."""

    first_frame: int  #: number of the first frame
    frames: int  #: frames in the GOP
    start_pts: int  #: presentation timestamp of the first frame, ticks
    last_pts: int  #: presentation timestamp of the last frame, ticks
    gaussians: int  #: Gaussians of the GOP, those carried over and the new ones
    reference_frame: int | None  #: first frame of the GOP it is predicted from; None = key GOP
    carried: int  #: Gaussians taken over from that GOP
    dropped: int  #: Gaussians of that GOP that are not taken over
    changed: int  #: carried Gaussians whose look changes
    moved: int  #: carried Gaussians that move
    new: int  #: Gaussians of its own
    grid: tuple[int, int, int]  #: Gx, Gy, Gt of the tri-plane; all 0 = no tri-plane
    parameters: int  #: stored numbers, before quantisation
    bytes: int  #: size of the payload


@dataclass(frozen=True, slots=True)
class FileInfo:
    """Properties of a .gsvr file."""

    path: str
    metadata: Metadata
    gops: tuple[GopInfo, ...]
    image_codecs: bool  #: whether planes coded as PNG or JPEG XL may occur, by the header
    recovered: bool  #: whether the file has no valid index: it is cut short or damaged
    warnings: tuple[str, ...]  #: faults that do not prevent decoding

    @property
    def parameters(self) -> int:
        """Parameters of all GOPs, before quantisation."""
        return sum(gop.parameters for gop in self.gops)

    @property
    def key_gops(self) -> int:
        """GOPs that need no other."""
        return sum(gop.reference_frame is None for gop in self.gops)

    @property
    def carried(self) -> int:
        """Gaussians that GOPs take over from others, summed over the GOPs."""
        return sum(gop.carried for gop in self.gops)

    def to_dict(self) -> dict[str, Any]:
        """Return all of it as JSON can hold it."""
        meta = self.metadata
        return {
            "file": self.path,
            "version": meta.version,
            "image_codecs": self.image_codecs,
            "width": meta.width,
            "height": meta.height,
            "frames": meta.frames,
            "gops": meta.gops,
            "key_gops": self.key_gops,
            "gaussians": meta.gaussians,
            "carried_gaussians": self.carried,
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
        return FileInfo(
            os.fspath(path),
            Metadata.of(reader),
            tuple(gops),
            reader.header.image_codecs,
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

    A GOP that is predicted from a damaged or lost one is a fault too.

    Raises:
        InputError, CorruptError, UnsupportedError: As `inspect`, if the file cannot be opened.
    """
    limits = limits or Limits.from_environment()
    with GsvrReader(path, limits) as reader:
        if reader.recovered:
            yield from reader.warnings
        gops = {entry.offset: position for position, entry in enumerate(reader.gops)}
        unpacker = GopUnpacker(reader, limits)
        for chunk in reader.chunks:
            try:
                if chunk.offset in gops:
                    unpacker.unpack(gops[chunk.offset])
                else:
                    reader.read_chunk(chunk)
            except CorruptError as error:
                yield str(error)
                if error.offset != chunk.offset:
                    yield from _own_fault(reader, gops[chunk.offset], limits)


def _own_fault(reader: GsvrReader, position: int, limits: Limits) -> Iterator[str]:
    """Yield the fault of a GOP whose reference is damaged, if it has one of its own."""
    try:
        payload = reader.read_gop(position)
        unpack_gop(payload, reader.header, limits)
    except CorruptError as error:
        yield str(error.located(GOP_TYPE.decode(), reader.gops[position].offset))


def _gop_info(entry: GopEntry, head: GopHead) -> GopInfo:
    """Return the properties of a GOP from its index entry and its head."""
    shape = head.shape
    return GopInfo(
        first_frame=entry.first_frame,
        frames=entry.frames,
        start_pts=entry.start_pts,
        last_pts=entry.last_pts,
        gaussians=entry.gaussians,
        reference_frame=None if entry.is_key else entry.reference_frame,
        carried=head.carried_from - head.dropped,
        dropped=head.dropped,
        changed=head.changed,
        moved=head.moved,
        new=head.new,
        grid=head.grid,
        parameters=sum(a.components * shape.samples(a.grid) for a in ALL_ATTRIBUTES),
        bytes=entry.size,
    )
