"""Inspection and verification of a .gsvr file; nothing is rendered."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

from gsvrcodec.bitstream.chunk import (
    GOP_TYPE,
    METADATA_TYPE,
    SETTINGS_TYPE,
    STREAMS_TYPE,
    ChunkEntry,
)
from gsvrcodec.bitstream.gop_chain import GopUnpacker
from gsvrcodec.bitstream.gop_head import GopEntry, GopHead
from gsvrcodec.bitstream.gop_payload import unpack_gop
from gsvrcodec.bitstream.header import Header
from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.bitstream.source import Readable
from gsvrcodec.bitstream.tags import container_of, parse_settings, parse_tags
from gsvrcodec.decoder.frames import Metadata
from gsvrcodec.errors import CorruptError
from gsvrcodec.limits import Limits
from gsvrcodec.model.reconstruction import Blending
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
    gops: tuple[GopInfo, ...]  #: but for those whose heads are damaged
    blending: Blending  #: whether pictures are means of Gaussians or sums, by the header
    plates: bool  #: whether still pictures may lie behind the Gaussians, by the header
    image_codecs: bool  #: whether planes coded as PNG or JPEG XL may occur, by the header
    stream: bool  #: whether the file was written front to back, by the header
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
            "blending": self.blending,
            "plates": self.plates,
            "image_codecs": self.image_codecs,
            "stream": self.stream,
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


def inspect(source: Readable, *, limits: Limits | None = None) -> FileInfo:
    """Return the properties of a file, from its header, its index and the heads of its GOPs.

    Args:
        source: Path, URL, bytes, or a binary file object.
        limits: Limits on the content; None = the defaults, or those of the environment.

    Raises:
        InputError: The file cannot be read.
        CorruptError: The file is not a .gsvr file, or no GOP is whole.
        UnsupportedError: The file needs a feature that this version does not have, or is over
            `limits`.
    """
    with GsvrReader(source, limits) as reader:
        reader.to_the_end()
        gops, warnings = [], list(reader.warnings)
        for position, entry in enumerate(reader.gops):
            try:
                gops.append(_gop_info(entry, reader.read_gop_head(position), reader.header))
            except CorruptError as error:
                warnings.append(str(error))
        return FileInfo(
            reader.name,
            Metadata.of(reader),
            tuple(gops),
            reader.header.blending,
            reader.header.plates,
            reader.header.image_codecs,
            reader.header.stream,
            reader.recovered,
            tuple(warnings),
        )


def inspect_bytes(source: Readable, *, limits: Limits | None = None) -> tuple[Item, ...]:
    """Return the bytes of a file by purpose; reads the whole file. Raises as `inspect`."""
    with GsvrReader(source, limits) as reader:
        reader.to_the_end()
        return spending(reader, limits)


def verify(source: Readable, *, limits: Limits | None = None) -> Iterator[str]:
    """Check every rule of the spec that needs no rendering; yield one sentence a fault.

    Every checksum is checked and every plane decoded. A GOP that is predicted from a damaged or
    lost one is a fault too. Each sentence ends with the section of the spec that has the rule.

    Raises:
        InputError, UnsupportedError: As `inspect`.
    """
    limits = limits or Limits.from_environment()
    try:
        with GsvrReader(source, limits) as reader:
            reader.to_the_end()
            yield from _faults(reader, limits)
    except CorruptError as error:
        yield _sentence(error)


def _faults(reader: GsvrReader, limits: Limits) -> Iterator[str]:
    """Yield the faults of a file that could be opened."""
    if reader.recovered:
        yield from (f"{each} (spec section 11)" for each in reader.warnings)
    else:
        yield from (f"{each} (spec section 3)" for each in reader.repeated)
    gops = {entry.offset: position for position, entry in enumerate(reader.gops)}
    unpacker = GopUnpacker(reader, limits)
    for chunk in reader.chunks:
        try:
            if chunk.offset in gops:
                unpacker.unpack(gops[chunk.offset])
            else:
                _check_auxiliary(reader, chunk)
        except CorruptError as error:
            yield _sentence(error.located(chunk.name, chunk.offset))
            if error.offset is not None and error.offset != chunk.offset:
                yield from _own_fault(reader, gops[chunk.offset], limits)


def _own_fault(reader: GsvrReader, position: int, limits: Limits) -> Iterator[str]:
    """Yield the fault of a GOP whose reference is damaged, if it has one of its own."""
    try:
        payload = reader.read_gop(position)
        unpack_gop(payload, reader.header, limits)
    except CorruptError as error:
        yield _sentence(error.located(GOP_TYPE.decode(), reader.gops[position].offset))


def _check_auxiliary(reader: GsvrReader, chunk: ChunkEntry) -> None:
    """Raise a CorruptError if a chunk that is no GOP is damaged or breaks a rule."""
    payload = reader.read_chunk(chunk)
    if chunk.type == SETTINGS_TYPE:
        parse_settings(payload)
    elif chunk.type == METADATA_TYPE:
        described, there = len(parse_tags(payload).streams), len(reader.streams)
        if described not in (0, there):
            raise CorruptError(f"tags of {described} streams, {there} are there", section="10")
    elif chunk.type == STREAMS_TYPE:
        container_of(payload)


def _sentence(error: CorruptError) -> str:
    """What is wrong, and the section of the spec that says so."""
    return f"{error} (spec section {error.section})" if error.section else str(error)


def _gop_info(entry: GopEntry, head: GopHead, header: Header) -> GopInfo:
    """Return the properties of a GOP from its index entry and its head."""
    shape = head.shape(header.blending)
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
        parameters=sum(a.components * shape.samples(a.grid) for a in shape.attributes()),
        bytes=entry.size,
    )
