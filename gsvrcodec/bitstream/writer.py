"""Writer of .gsvr files and streams, chunk by chunk; an unfinished one can be read at any time."""

from __future__ import annotations

from dataclasses import replace
from types import TracebackType
from typing import BinaryIO, Self

from gsvrcodec.bitstream.chunk import (
    END_TYPE,
    GOP_TYPE,
    HEAD_TYPE,
    INDEX_TYPE,
    OVERHEAD_BYTES,
    SIGNATURE,
    SINGLE_TYPES,
    STRUCTURAL_TYPES,
    ChunkEntry,
    Payload,
    chunk_bytes,
    chunk_parts,
    is_critical,
)
from gsvrcodec.bitstream.gop_head import GopEntry, parse_gop_head
from gsvrcodec.bitstream.header import (
    IMAGE_CODECS_FLAG,
    PLATES_FLAG,
    STREAM_FLAG,
    UNKNOWN_GRID,
    UNKNOWN_MAXIMUM,
    Header,
)
from gsvrcodec.bitstream.index import END_CHUNK_BYTES, end_payload, index_bytes, index_payload
from gsvrcodec.bitstream.plane_entries import IMAGE_CODECS, plane_codecs


class GsvrWriter:
    """Writes the header, GOPs and auxiliary chunks of a file, and then the index.

    The writer keeps the maxima and counts of the header: it rewrites the header chunk, which has a
    fixed size, when a GOP raises a maximum or is the first with a plate or planes of image codecs,
    and once more in `close`. A stream is written front to back: maxima and counts are not known.

    Args:
        file: Empty and writable, and seekable if it is no stream; `close` leaves it open.
        header: Picture, colour and time base; the writer replaces maxima, counts and flags, but in
            a stream the flags of plates and of image codecs have to be right.
        stream: Write front to back, and each chunk at once.
    """

    def __init__(self, file: BinaryIO, header: Header, *, stream: bool = False) -> None:
        self._file = file
        self._stream = stream
        flags, required = header.flags_optional, header.flags_required
        flags = flags | STREAM_FLAG if stream else flags & ~(STREAM_FLAG | IMAGE_CODECS_FLAG)
        most = UNKNOWN_MAXIMUM if stream else 0
        self._header = replace(
            header,
            flags_required=required if stream else required & ~PLATES_FLAG,
            flags_optional=flags,
            max_gaussians=most,
            max_gop_frames=most,
            max_grid=UNKNOWN_GRID if stream else (0, 0, 0),
            frames=0,
            gops=0,
        )
        self._chunks: list[ChunkEntry] = []
        self._gops: list[GopEntry] = []
        self._by_first_frame: dict[int, GopEntry] = {}
        self._closed = False
        start = SIGNATURE + chunk_bytes(HEAD_TYPE, self._header.to_bytes())
        if not stream:
            file.seek(0)
        file.write(start)
        self._end = len(start)

    @property
    def header(self) -> Header:
        """The header that the file has now."""
        return self._header

    @property
    def gops(self) -> tuple[GopEntry, ...]:
        """The GOPs written so far."""
        return tuple(self._gops)

    @property
    def gaussians(self) -> int:
        """Sum of the Gaussians of all GOPs written so far, those carried over included."""
        return sum(gop.gaussians for gop in self._gops)

    @property
    def size(self) -> int:
        """Bytes written so far."""
        return self._end

    def add_gop(self, payload: bytes) -> GopEntry:
        """Append a GOP chunk.

        Args:
            payload: As from `pack_gop`.

        Returns:
            Summary and place of the GOP.

        Raises:
            ValueError: The head is invalid, does not follow the last GOP, or refers to a GOP that
                was not added or has another number of Gaussians; a stream has plates or planes of
                image codecs, and its header has not their flag.
        """
        head = parse_gop_head(payload)
        head.check_follows(self._gops[-1] if self._gops else None)
        head.check_reference(self._by_first_frame)
        if not head.is_key:
            reference = self._by_first_frame[head.reference_frame]
            if reference.gaussians != head.carried_from:
                raise ValueError(
                    f"the reference has {reference.gaussians} Gaussians, "
                    f"the GOP expects {head.carried_from}"
                )
        image_codecs = not IMAGE_CODECS.isdisjoint(plane_codecs(payload, head))
        (gx, gy, gt), (most_x, most_y, most_t) = head.grid, self._header.max_grid
        raised = replace(
            self._header,
            flags_required=self._header.flags_required | PLATES_FLAG * head.plate,
            flags_optional=self._header.flags_optional | IMAGE_CODECS_FLAG * image_codecs,
            max_gaussians=max(self._header.max_gaussians, head.gaussians),
            max_gop_frames=max(self._header.max_gop_frames, head.frames),
            max_grid=(max(most_x, gx), max(most_y, gy), max(most_t, gt)),
        )
        if self._stream and raised != self._header:
            raise ValueError("plates or image codecs in a stream that has not their flag")
        self._rewrite_header(raised)
        entry = head.entry(ChunkEntry(GOP_TYPE, self._end, len(payload)))
        self._append(GOP_TYPE, payload)
        self._gops.append(entry)
        self._by_first_frame[entry.first_frame] = entry
        return entry

    def add_auxiliary(self, kind: bytes, payload: Payload) -> None:
        """Append an ancillary chunk, which a decoder may skip.

        Args:
            kind: Type of the chunk: four ASCII letters, the first in lower case, as b"sett".
            payload: Payload of the chunk.

        Raises:
            ValueError: `kind` is no ancillary type, is reserved for the writer, or is the type of
                a chunk that a file has once.
        """
        if is_critical(kind) or kind in STRUCTURAL_TYPES:
            raise ValueError(f"{kind!r} is not the type of an auxiliary chunk")
        if kind in SINGLE_TYPES and any(chunk.type == kind for chunk in self._chunks):
            raise ValueError(f"a second chunk {kind!r}")
        self._append(kind, payload)

    def final_size(self, chunks: int, payload_bytes: int) -> int:
        """Bytes of the closed file after `chunks` more chunks with `payload_bytes` in all."""
        index = index_bytes(len(self._chunks) + chunks)
        return self._end + chunks * OVERHEAD_BYTES + payload_bytes + index + END_CHUNK_BYTES

    def close(self) -> None:
        """Write the index, the end chunk and, but for a stream, the final header.

        A file without them is unfinished.

        Raises:
            ValueError: No GOP was added.
        """
        if self._closed:
            return
        if not self._gops:
            raise ValueError("a .gsvr file needs at least one GOP")
        index_offset = self._end
        index = chunk_bytes(INDEX_TYPE, index_payload(self._chunks, self._gops))
        file_size = index_offset + len(index) + END_CHUNK_BYTES
        self._write_at(
            index_offset, index, *chunk_parts(END_TYPE, end_payload(index_offset, file_size))
        )
        self._end = file_size
        if not self._stream:
            frames, gops = self._gops[-1].end_frame, len(self._gops)
            self._rewrite_header(replace(self._header, frames=frames, gops=gops))
        self._file.flush()
        self._closed = True

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is None:
            self.close()

    def _append(self, kind: bytes, payload: Payload) -> None:
        if self._closed:
            raise ValueError("the file is closed")
        entry = ChunkEntry(kind, self._end, len(payload))
        self._write_at(self._end, *chunk_parts(kind, payload))
        self._chunks.append(entry)
        self._end = entry.end

    def _rewrite_header(self, header: Header) -> None:
        """Overwrite the header chunk if `header` differs from the one in the file."""
        if header == self._header:
            return
        self._write_at(len(SIGNATURE), chunk_bytes(HEAD_TYPE, header.to_bytes()))
        self._header = header

    def _write_at(self, offset: int, *parts: Payload) -> None:
        """Write at an offset; of a stream, this is where it ends."""
        if not self._stream:
            self._file.seek(offset)
        for part in parts:
            self._file.write(part)
        if self._stream:
            self._file.flush()
