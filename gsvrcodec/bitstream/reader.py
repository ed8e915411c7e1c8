"""Reader of .gsvr files: uses the index if it is valid, else walks from chunk to chunk.

A pipe is always walked: its GOPs are known as they come.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter
from collections.abc import Sequence
from threading import Lock
from types import TracebackType
from typing import Any, Self

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
    SINGLE_TYPES,
    STREAMS_TYPE,
    ChunkEntry,
    check_payload,
    check_signature,
    is_critical,
    parse_chunk_head,
)
from gsvrcodec.bitstream.gop_head import (
    GOP_HEAD_BYTES,
    SUMMARY_BYTES,
    GopEntry,
    GopHead,
    parse_gop_head,
)
from gsvrcodec.bitstream.header import Header, parse_header
from gsvrcodec.bitstream.index import END_CHUNK_BYTES, parse_end, parse_index
from gsvrcodec.bitstream.recovery import Walk
from gsvrcodec.bitstream.references import References
from gsvrcodec.bitstream.source import Readable, open_source
from gsvrcodec.bitstream.tags import Tags, parse_settings, parse_tags
from gsvrcodec.errors import CorruptError, UnsupportedError, spec_section
from gsvrcodec.limits import Limits

#: Greatest payload of a header chunk, of any version.
_MAX_HEADER_BYTES = 4096


class GsvrReader:
    """Header, GOPs and auxiliary chunks of a file; payloads are read on demand.

    Safe to use from several threads.

    Args:
        source: What to read; see `Readable`. Of what is not seekable, such as a pipe, `gops` and
            `chunks` hold what came, from the first GOP on; `grow` waits for more.
        limits: Limits on the content, None = `Limits.from_environment()`.

    Raises:
        InputError: The file cannot be read.
        NotGsvrError: The file does not start with the signature.
        CorruptError: The header is damaged, or no GOP is whole.
        UnsupportedError: The file needs a feature that this version does not have.
        LimitError: The file is over `limits`.
    """

    def __init__(self, source: Readable, limits: Limits | None = None) -> None:
        self._limits = limits or Limits.from_environment()
        self._source = open_source(source)
        try:
            self._open()
        except BaseException:
            self._source.close()
            raise

    def _open(self) -> None:
        check_signature(self._source.read_some(0, len(SIGNATURE)))
        head, self._header = self._read_header()
        self._index_fault: CorruptError | None = None
        self._walk: Walk | None = None
        self._chunks = [head]
        self._gops: list[GopEntry] = []
        self._references = References(self._limits)
        self._growing = Lock()
        if self._source.arriving:
            self._walk = Walk(self._source, head.end, self._limits, stream=True)
            self.grow()
        else:
            try:
                chunks, gops = self._read_index(head.end)
            except CorruptError as error:
                self._index_fault = error
                stream = self._header.stream
                self._walk = Walk(self._source, head.end, self._limits, stream=stream).to_the_end()
                chunks, gops = self._walk.chunks, self._walk.gops
            self._add(chunks, gops)
        if not self._gops:
            message = "; ".join(("the file has no whole GOP", *self.warnings))
            raise CorruptError(message, section="3")

    def grow(self) -> bool:
        """Wait for the next GOP of a pipe; return False if none comes any more.

        Raises:
            CorruptError, UnsupportedError, LimitError: As when a file is opened.
            InputError: The pipe cannot be read.
        """
        walk = self._walk
        with self._growing:
            if walk is None or walk.over:
                return False
            chunks, gops = len(walk.chunks), len(walk.gops)
            while len(walk.gops) == gops and walk.step():
                pass
            self._add(walk.chunks[chunks:], walk.gops[gops:])
            return len(walk.gops) > gops

    def to_the_end(self) -> None:
        """Wait until all of a pipe has come; raises as `grow`."""
        while self.grow():
            pass

    def _add(self, chunks: Sequence[ChunkEntry], gops: Sequence[GopEntry]) -> None:
        """Add what is known now; the GOPs last, for other threads may take them at once."""
        self._chunks += chunks
        self._references.add(gops)
        self._gops += gops

    @property
    def name(self) -> str:
        """What is read, for messages: path, URL, or the name of a file object."""
        return self._source.name

    @property
    def header(self) -> Header:
        """The header of the file."""
        return self._header

    @property
    def gops(self) -> Sequence[GopEntry]:
        """The GOPs in frame order; only a damaged file may lack frames between two GOPs."""
        return self._gops

    @property
    def chunks(self) -> Sequence[ChunkEntry]:
        """Every chunk in file order, with type, offset and payload size."""
        return self._chunks

    @property
    def gaussians(self) -> int:
        """Sum of the Gaussians of all GOPs, those carried over included."""
        return sum(gop.gaussians for gop in self._gops)

    @property
    def frames(self) -> int:
        """Frames in the file: the number of the last frame plus one."""
        return self._gops[-1].end_frame if self._gops else 0

    @property
    def size(self) -> int:
        """Bytes of the file; of a pipe, of the chunks that came."""
        return self._chunks[-1].end if self._source.arriving else self._source.size

    @property
    def recovered(self) -> bool:
        """Whether the file is damaged or was not finished, so that GOPs may be missing.

        A stream may end after any GOP.
        """
        walk = self._walk
        if walk is None:
            return False
        return bool(walk.warnings) or self._lacks_end or (walk.ended and bool(self._index_fault))

    @property
    def complete(self) -> bool:
        """Whether all GOPs are known: not while a pipe may bring more."""
        return self._walk is None or self._walk.over

    @property
    def warnings(self) -> tuple[str, ...]:
        """Faults of the file that do not prevent decoding."""
        warnings = []
        if self._walk is not None:
            if self._index_fault is not None and self.recovered:
                fault = f"no valid index ({self._index_fault})"
                warnings.append(f"{fault}; the file was searched for GOPs instead")
            warnings += self._walk.warnings
            if self._lacks_end:
                warnings.append("the file has no end: its writing was not finished, or it is cut")
        warnings += self._references.warnings() + self.repeated
        return (*warnings, *self._count_warnings())

    @property
    def _lacks_end(self) -> bool:
        """Whether the file was read to its end, which should have an end chunk."""
        walk = self._walk
        return walk is not None and walk.over and not walk.ended and not self._header.stream

    def gop_of_frame(self, frame: int) -> int:
        """Position in `gops` of the GOP that holds frame number `frame`.

        Raises:
            IndexError: `frame` is negative or past the end of the file.
            CorruptError: The frame was lost.
        """
        if not 0 <= frame < self.frames:
            raise IndexError(f"frame {frame} of {self.frames}")
        position = bisect_right(self._gops, frame, key=lambda gop: gop.first_frame) - 1
        if position < 0 or frame >= self._gops[position].end_frame:
            raise CorruptError(f"frame {frame} is lost")
        return position

    def reference_of(self, position: int) -> int | None:
        """Position in `gops` of the GOP that `gops[position]` is predicted from; None = a key GOP.

        Raises:
            CorruptError: The reference was lost.
        """
        return self._references.reference_of(position)

    def chain_of(self, position: int) -> list[int]:
        """Positions of the GOPs that `gops[position]` needs: from its key GOP up to itself.

        Raises:
            CorruptError: A GOP of the chain was lost.
        """
        return self._references.chain_of(position)

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
                section="11",
            )
        return payload

    def read_gop_head(self, position: int) -> GopHead:
        """The head of `gops[position]`; no checksum is checked.

        Raises:
            CorruptError: The head breaks a rule of the spec.
        """
        chunk = self._gops[position].chunk
        try:
            return parse_gop_head(self._source.read_some(chunk.payload_offset, GOP_HEAD_BYTES))
        except CorruptError as error:
            raise error.located(chunk.name, chunk.offset) from None

    def read_chunk(self, chunk: ChunkEntry) -> bytes:
        """The payload of one of `chunks`, checked against its CRC.

        Raises:
            CorruptError: The chunk is damaged, or its head does not match the index.
            LimitError: The chunk is over the reader's limits.
        """
        if not self._source.reaches(chunk.end):
            raise CorruptError(
                f"{chunk.size} bytes, past the end of the file",
                chunk=chunk.name,
                offset=chunk.offset,
                section="3",
            )
        self._limits.check("chunk_bytes", chunk.size, f"the size of chunk {chunk.name}")
        data = self._source.read(chunk.offset, OVERHEAD_BYTES + chunk.size)
        try:
            if parse_chunk_head(data[:HEAD_BYTES], chunk.offset) != chunk:
                what = "the chunk is not the one that the index names"
                raise CorruptError(what, section="11")
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
        return parse_settings(payload)

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

    @spec_section("3")
    def _read_header(self) -> tuple[ChunkEntry, Header]:
        offset = len(SIGNATURE)
        if not self._source.reaches(offset + OVERHEAD_BYTES):
            raise CorruptError("cut short in the header", chunk="HEAD", offset=offset)
        chunk = parse_chunk_head(self._source.read(offset, HEAD_BYTES), offset)
        if chunk.type != HEAD_TYPE:
            raise CorruptError(
                f"the first chunk is {chunk.name}, expected HEAD", chunk=chunk.name, offset=offset
            )
        if chunk.size > _MAX_HEADER_BYTES or not self._source.reaches(chunk.end):
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

    @property
    def repeated(self) -> list[str]:
        """Warnings about chunks that a file may have once, and has more often; the first counts."""
        kinds = Counter(chunk.type for chunk in self._chunks)
        return [
            f"the file has {kinds[kind]} chunks {kind.decode()}, the first counts"
            for kind in SINGLE_TYPES
            if kinds[kind] > 1
        ]

    def _count_warnings(self) -> list[str]:
        """Warnings about counts of the header that differ from the content; the content wins."""
        if not self.complete:
            return []
        warnings = []
        for what, declared, found in (
            ("frames", self._header.frames, self.frames),
            ("GOPs", self._header.gops, len(self._gops)),
        ):
            if declared not in (0, found):
                warnings.append(f"the header says {declared} {what}, the file has {found}")
        return warnings
