"""Reader of .gsvr files: uses the index if it is valid, else walks from chunk to chunk."""

from __future__ import annotations

import json
import os
from bisect import bisect_right
from types import TracebackType
from typing import Any, BinaryIO, Self

from gsvrcodec.bitstream.chunk import (
    CRITICAL_TYPES,
    END_TYPE,
    HEAD_BYTES,
    HEAD_TYPE,
    INDEX_TYPE,
    METADATA_TYPE,
    OVERHEAD_BYTES,
    SETTINGS_TYPE,
    SIGNATURE,
    STREAMS_TYPE,
    ChunkEntry,
    check_payload,
    check_signature,
    is_critical,
    parse_chunk_head,
)
from gsvrcodec.bitstream.gop_head import SUMMARY_BYTES, GopEntry
from gsvrcodec.bitstream.header import Header, parse_header
from gsvrcodec.bitstream.index import END_CHUNK_BYTES, parse_end, parse_index
from gsvrcodec.bitstream.recovery import walk
from gsvrcodec.bitstream.source import Source
from gsvrcodec.bitstream.tags import Tags, parse_tags
from gsvrcodec.errors import CorruptError, UnsupportedError
from gsvrcodec.limits import Limits

#: Greatest payload of a header chunk, of any version.
_MAX_HEADER_BYTES = 4096


class GsvrReader:
    """Header, GOPs and auxiliary chunks of a file; payloads are read on demand.

    Safe to use from several threads.

    Args:
        source: Path, or a seekable binary stream, which stays open.
        limits: Limits on the content, None = `Limits.from_environment()`.

    Raises:
        InputError: The file cannot be read.
        NotGsvrError: The file does not start with the signature.
        CorruptError: The header is damaged, or no GOP is whole.
        UnsupportedError: The file needs a feature that this version does not have.
        LimitError: The file is over `limits`.
    """

    def __init__(
        self, source: str | os.PathLike[str] | BinaryIO, limits: Limits | None = None
    ) -> None:
        self._limits = limits or Limits.from_environment()
        self._source = Source(source)
        try:
            self._open()
        except BaseException:
            self._source.close()
            raise

    def _open(self) -> None:
        start = self._source.read(0, min(len(SIGNATURE), self._source.size))
        check_signature(start)
        head, self._header = self._read_header()
        warnings: list[str] = []
        try:
            chunks, gops = self._read_index(head.end)
            self._recovered = False
        except CorruptError as error:
            warnings.append(f"no valid index ({error}); the file was searched for GOPs instead")
            found = walk(self._source, head.end, self._limits)
            chunks, gops = found.chunks, found.gops
            warnings += found.warnings
            self._recovered = True
        self._chunks = (head, *chunks)
        self._gops = tuple(gops)
        self._first_frames = [gop.first_frame for gop in gops]
        if not gops:
            raise CorruptError("the file has no whole GOP; " + "; ".join(warnings))
        self._references = self._linked()
        self._warnings = (*warnings, *self._lost_warnings(), *self._count_warnings())

    @property
    def header(self) -> Header:
        """The header of the file."""
        return self._header

    @property
    def gops(self) -> tuple[GopEntry, ...]:
        """The GOPs in frame order; only a recovered file may lack frames between two GOPs."""
        return self._gops

    @property
    def chunks(self) -> tuple[ChunkEntry, ...]:
        """Every chunk in file order, with type, offset and payload size."""
        return self._chunks

    @property
    def gaussians(self) -> int:
        """Sum of the Gaussians of all GOPs, those carried over included."""
        return sum(gop.gaussians for gop in self._gops)

    @property
    def frames(self) -> int:
        """Frames in the file: the number of the last frame plus one."""
        return self._gops[-1].end_frame

    @property
    def size(self) -> int:
        """Bytes of the file."""
        return self._source.size

    @property
    def recovered(self) -> bool:
        """Whether the file has no valid index: it is damaged or was not finished."""
        return self._recovered

    @property
    def warnings(self) -> tuple[str, ...]:
        """Faults of the file that do not prevent decoding."""
        return self._warnings

    def gop_of_frame(self, frame: int) -> int:
        """Position in `gops` of the GOP that holds frame number `frame`.

        Raises:
            IndexError: `frame` is negative or past the end of the file.
            CorruptError: The frame was lost.
        """
        if not 0 <= frame < self.frames:
            raise IndexError(f"frame {frame} of {self.frames}")
        position = bisect_right(self._first_frames, frame) - 1
        if position < 0 or frame >= self._gops[position].end_frame:
            raise CorruptError(f"frame {frame} is lost")
        return position

    def reference_of(self, position: int) -> int | None:
        """Position in `gops` of the GOP that `gops[position]` is predicted from; None = a key GOP.

        Raises:
            CorruptError: The reference was lost.
        """
        entry = self._gops[position]
        if entry.is_key:
            return None
        reference = self._references[position]
        if reference is None:
            raise CorruptError(
                f"the GOP at frame {entry.reference_frame} is lost, "
                f"which the GOP at frame {entry.first_frame} is predicted from",
                chunk=entry.chunk.name,
                offset=entry.offset,
            )
        return reference

    def chain_of(self, position: int) -> list[int]:
        """Positions of the GOPs that `gops[position]` needs: from its key GOP up to itself.

        Raises:
            CorruptError: A GOP of the chain was lost.
        """
        chain = [position]
        while (reference := self.reference_of(chain[-1])) is not None:
            chain.append(reference)
        return chain[::-1]

    def read_gop(self, position: int) -> bytes:
        """The payload of `gops[position]`, checked against its CRC and its index entry.

        `unpack_gop` parses the payload and checks the rest.

        Raises:
            CorruptError: The chunk is damaged or does not match the index.
            LimitError: The chunk is over the reader's limits.
        """
        entry = self._gops[position]
        payload = self.read_chunk(entry.chunk)
        if payload[:SUMMARY_BYTES] != entry.summary_bytes():
            raise CorruptError(
                "the GOP is not the one that the index names",
                chunk=entry.chunk.name,
                offset=entry.offset,
            )
        return payload

    def read_chunk(self, chunk: ChunkEntry) -> bytes:
        """The payload of one of `chunks`, checked against its CRC.

        Raises:
            CorruptError: The chunk is damaged, or its head does not match the index.
            LimitError: The chunk is over the reader's limits.
        """
        if chunk.end > self._source.size:
            raise CorruptError(
                f"{chunk.size} bytes, past the end of the file",
                chunk=chunk.name,
                offset=chunk.offset,
            )
        self._limits.check("chunk_bytes", chunk.size, f"the size of chunk {chunk.name}")
        data = self._source.read(chunk.offset, OVERHEAD_BYTES + chunk.size)
        try:
            if parse_chunk_head(data[:HEAD_BYTES], chunk.offset) != chunk:
                raise CorruptError("the chunk is not the one that the index names")
            return check_payload(chunk, data[HEAD_BYTES:])
        except CorruptError as error:
            raise error.located(chunk.name, chunk.offset) from None

    def auxiliary(self, kind: bytes) -> bytes | None:
        """The payload of the first chunk of type `kind`; None = no such chunk.

        Raises:
            CorruptError: The chunk is damaged.
            LimitError: The chunk is over the reader's limits.
        """
        for chunk in self._chunks:
            if chunk.type == kind:
                if kind in (SETTINGS_TYPE, METADATA_TYPE):
                    self._limits.check("metadata_bytes", chunk.size, f"chunk {chunk.name}")
                return self.read_chunk(chunk)
        return None

    def settings(self) -> dict[str, Any]:
        """The encoder settings from chunk `sett`; empty without that chunk.

        Raises:
            CorruptError: The chunk is damaged, or not a JSON object.
            LimitError: The chunk is over the reader's limits.
        """
        payload = self.auxiliary(SETTINGS_TYPE)
        if payload is None:
            return {}
        try:
            value = json.loads(payload.decode("utf-8"))
        except (ValueError, RecursionError):
            value = None
        if not isinstance(value, dict):
            raise CorruptError("not a JSON object in UTF-8", chunk=SETTINGS_TYPE.decode())
        return value

    def tags(self) -> Tags:
        """Titles, languages and chapters from chunk `meta`; empty without that chunk.

        Raises:
            CorruptError: The chunk is damaged, or breaks a rule of the spec.
            LimitError: The chunk is over the reader's limits.
        """
        payload = self.auxiliary(METADATA_TYPE)
        return Tags() if payload is None else parse_tags(payload)

    @property
    def streams(self) -> tuple[ChunkEntry, ...]:
        """The `strm` chunks; each payload is a container file with one copied stream."""
        return tuple(chunk for chunk in self._chunks if chunk.type == STREAMS_TYPE)

    def close(self) -> None:
        """Close the file if the reader opened it."""
        self._source.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _read_header(self) -> tuple[ChunkEntry, Header]:
        offset = len(SIGNATURE)
        if self._source.size < offset + OVERHEAD_BYTES:
            raise CorruptError("cut short in the header", chunk="HEAD", offset=offset)
        chunk = parse_chunk_head(self._source.read(offset, HEAD_BYTES), offset)
        if chunk.type != HEAD_TYPE:
            raise CorruptError(
                f"the first chunk is {chunk.name}, expected HEAD", chunk=chunk.name, offset=offset
            )
        if chunk.size > _MAX_HEADER_BYTES or chunk.end > self._source.size:
            raise CorruptError(f"header of {chunk.size} bytes", chunk="HEAD", offset=offset)
        payload = self.read_chunk(chunk)
        try:
            return chunk, parse_header(payload, self._limits)
        except CorruptError as error:
            raise error.located(chunk.name, offset) from None

    def _read_index(self, start: int) -> tuple[list[ChunkEntry], list[GopEntry]]:
        """Chunks after the header, which ends at byte `start`, and the GOPs among them."""
        size = self._source.size
        end_offset = size - END_CHUNK_BYTES
        if end_offset < start:
            raise CorruptError("the end chunk is missing")
        end_chunk = parse_chunk_head(self._source.read(end_offset, HEAD_BYTES), end_offset)
        if end_chunk.type != END_TYPE or end_chunk.end != size:
            raise CorruptError("the end chunk is missing")
        index_offset = parse_end(self.read_chunk(end_chunk), size)
        if index_offset < start:
            raise CorruptError(f"index at byte {index_offset}")
        index_chunk = parse_chunk_head(self._source.read(index_offset, HEAD_BYTES), index_offset)
        if index_chunk.type != INDEX_TYPE or index_chunk.end != end_offset:
            raise CorruptError(f"no index at byte {index_offset}")
        chunks, gops = parse_index(self.read_chunk(index_chunk), start, index_offset, self._limits)
        for chunk in chunks:
            if is_critical(chunk.type) and chunk.type not in CRITICAL_TYPES:
                raise UnsupportedError(
                    f"chunk {chunk.name} at byte {chunk.offset} is needed to decode this file, "
                    "and this decoder does not know it"
                )
        return [*chunks, index_chunk, end_chunk], gops

    def _linked(self) -> list[int | None]:
        """Position of the reference of each GOP; None = a key GOP, or the reference was lost.

        Raises:
            LimitError: A chain of references is over the limit.
        """
        positions: dict[int, int] = {}
        references: list[int | None] = []
        lengths: list[int] = []
        for position, gop in enumerate(self._gops):
            reference = None if gop.is_key else positions.get(gop.reference_frame)
            references.append(reference)
            lengths.append(1 if reference is None else lengths[reference] + 1)
            positions[gop.first_frame] = position
        self._limits.check("chain", max(lengths), "the number of GOPs in a chain of references")
        return references

    def _lost_warnings(self) -> list[str]:
        """A warning if references of GOPs were lost."""
        lost = [
            gop.first_frame
            for gop, reference in zip(self._gops, self._references, strict=True)
            if reference is None and not gop.is_key
        ]
        if not lost:
            return []
        return [f"{len(lost)} GOPs are predicted from lost ones, the first at frame {lost[0]}"]

    def _count_warnings(self) -> list[str]:
        """Warnings about counts of the header that differ from the content; the content wins."""
        warnings = []
        for what, declared, found in (
            ("frames", self._header.frames, self.frames),
            ("GOPs", self._header.gops, len(self._gops)),
        ):
            if declared not in (0, found):
                warnings.append(f"the header says {declared} {what}, the file has {found}")
        return warnings
