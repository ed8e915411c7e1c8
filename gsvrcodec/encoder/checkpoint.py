"""Finished GOPs, kept beside the output until it is whole, so that an encode can be resumed.

The file `OUTPUT.part` is a row of chunks as in a .gsvr file, under a signature of its own:

    plan  JSON object: what the encode was begun with
    stat  JSON object: the analysis of the input
    size  JSON object: what a first pass found, where the file has a size to meet
    part  a finished GOP: length of a JSON object (u32), the object, the GOP's payload

Nothing is believed without its CRC; what a kill or a power cut left half-written is dropped.
"""

from __future__ import annotations

import json
import os
import struct
import tempfile
import threading
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, NamedTuple, Self

from gsvrcodec.bitstream.chunk import (
    HEAD_BYTES,
    OVERHEAD_BYTES,
    ChunkEntry,
    check_payload,
    chunk_bytes,
    parse_chunk_head,
)
from gsvrcodec.encoder.analysis import Analysis
from gsvrcodec.encoder.first_pass import Plan, plan_from_json, plan_to_json
from gsvrcodec.encoder.results import EncodedGop
from gsvrcodec.errors import CorruptError, OutputError
from gsvrcodec.files import lock, named, remove_partials

_SIGNATURE = b"\x89GSP\r\n\x1a\n"
_PLAN, _ANALYSIS, _SIZE, _PART = b"plan", b"stat", b"size", b"part"
_LENGTH = struct.Struct("<I")
#: Of a finished GOP, beside its frames.
_FIGURES = ("psnr", "float_psnr", "seconds", "qscale", "plate_bytes")


class _Kept(NamedTuple):
    """A finished GOP in the file."""

    figures: EncodedGop  #: without its payload
    entry: ChunkEntry  #: where the part is
    payload_bytes: int


class Checkpoint:
    """The finished GOPs of one encode; only one process at a time has them. Thread-safe.

    As a context manager: when the block succeeds the file is removed; when it fails the file
    stays if it holds a GOP, and the error gets a note that says how to go on.

    Args:
        target: the output; None = nothing is to be kept.
        plan: all that the content depends on, as JSON.
        resume: go on with what is there.
        restart: throw away what is there, unless `resume`.

    Raises:
        OutputError: another process has them; something is there and neither `resume` nor
            `restart` is set; it was begun with another plan; it cannot be read or written.
    """

    def __init__(
        self, target: Path | None, plan: Mapping[str, Any], *, resume: bool, restart: bool
    ) -> None:
        self._entries: dict[range, _Kept] = {}
        self._analysis: Analysis | None = None
        self._first_pass: Plan | None = None
        self._end = 0
        self._lock = threading.Lock()  # of the place in the file
        self._file: BinaryIO
        content: dict[str, Any] = json.loads(json.dumps(plan))
        if target is None:
            self.path: Path | None = None  #: of the file; None = it has no name
            self._file = tempfile.TemporaryFile()  # noqa: SIM115, closed by leaving the block
            self._begin(content)
            return
        resolved = target.resolve()
        self.path = resolved.with_name(f"{resolved.name}.part")
        with named(self.path):
            self._file = lock(self.path)
            try:
                remove_partials(resolved)  # with the lock, they are nobody's
                self._open(content, resume=resume, restart=restart and not resume)
            except BaseException:
                self._file.close()
                raise

    def __enter__(self) -> Self:
        """Return the parts themselves."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Remove the file, or keep it and say so in the error."""
        if self.path is not None:
            if error is None or not self._entries:
                with suppress(OSError):
                    self.path.unlink(missing_ok=True)
            else:
                count = len(self._entries)
                error.add_note(
                    f"{count} finished GOP{'s are' if count > 1 else ' is'} kept in {self.path}, "
                    "`resume=True` goes on from there"
                )
        self._file.close()

    def __contains__(self, gop: range) -> bool:
        """Tell whether a GOP is finished."""
        return gop in self._entries

    def __iter__(self) -> Iterator[range]:
        """Yield the GOPs that are finished."""
        return iter(tuple(self._entries))

    def __len__(self) -> int:
        """Return how many GOPs are finished."""
        return len(self._entries)

    @property
    def analysis(self) -> Analysis | None:
        """The analysis of the input; None = it was not kept."""
        return self._analysis

    def keep_analysis(self, analysis: Analysis) -> None:
        """Keep the analysis of the input."""
        self._append(_ANALYSIS, json.dumps(analysis.to_json()).encode())
        self._analysis = analysis

    @property
    def first_pass(self) -> Plan | None:
        """What a first pass found; None = it was not kept."""
        return self._first_pass

    def keep_first_pass(self, found: Plan) -> None:
        """Keep what a first pass found."""
        self._append(_SIZE, json.dumps(plan_to_json(found)).encode())
        self._first_pass = found

    def add(self, gop: EncodedGop) -> None:
        """Keep a finished GOP; it is on the disk when this returns."""
        frames = [gop.frames.start, gop.frames.stop]
        figures = {name: getattr(gop, name) for name in _FIGURES}
        text = json.dumps({"frames": frames, "figures": figures}).encode()
        entry = self._append(_PART, _LENGTH.pack(len(text)) + text + gop.payload)
        self._entries[gop.frames] = _Kept(replace(gop, payload=b""), entry, len(gop.payload))

    def figures(self, gop: range) -> EncodedGop:
        """Return a finished GOP without its payload; KeyError if it is not there."""
        return self._entries[gop].figures

    def size(self, gop: range) -> int:
        """Return the bytes of the payload of a finished GOP; KeyError if it is not there."""
        return self._entries[gop].payload_bytes

    def payload(self, gop: range) -> bytes:
        """Return the payload of a GOP, read back from the file.

        Raises:
            OutputError: it is not what was written.
        """
        name = self.path or "the temporary file"
        try:
            with named(name):
                return _split(self._read(self._entries[gop].entry))[1]
        except CorruptError as error:
            raise OutputError(f"{name} is not what was written to it: {error}") from error

    def result(self, gop: range) -> EncodedGop:
        """Return a finished GOP as its job did. Raises as `payload`."""
        return replace(self.figures(gop), payload=self.payload(gop))

    def _open(self, plan: dict[str, Any], *, resume: bool, restart: bool) -> None:
        """Take what the file holds, or begin it."""
        found = None if self._is_empty() or restart else self._load()
        if self._entries and not resume:
            raise OutputError(
                f"{self.path} holds {len(self._entries)} finished GOPs of an encode that was "
                "interrupted: `resume=True` goes on with it, `overwrite=True` starts anew"
            )
        different = ["nothing"] if found is None else list(_differences(found, plan))
        if self._entries and different:
            raise OutputError(
                f"{self.path} cannot be resumed: it was begun with {', '.join(different)}; "
                "say the same again, or start anew with `overwrite=True` alone"
            )
        if different:
            self._begin(plan)

    def _is_empty(self) -> bool:
        """Tell whether nothing is in the file yet; refuse one that somebody else has made."""
        start = self._file.read(len(_SIGNATURE))
        if not _SIGNATURE.startswith(start):
            raise OutputError(
                f"{self.path} is in the way: finished GOPs would be kept there; move it, "
                "or name another output"
            )
        return len(start) < len(_SIGNATURE)

    def _begin(self, plan: dict[str, Any]) -> None:
        self._entries, self._analysis, self._first_pass = {}, None, None
        self._end = len(_SIGNATURE)
        self._file.seek(0)
        self._file.truncate()
        self._file.write(_SIGNATURE)
        self._append(_PLAN, json.dumps(plan).encode())

    def _append(self, kind: bytes, payload: bytes) -> ChunkEntry:
        with self._lock, named(self.path or "the temporary file"):
            entry = ChunkEntry(kind, self._end, len(payload))
            self._file.seek(self._end)
            self._file.truncate()
            self._file.write(chunk_bytes(kind, payload))
            self._file.flush()
            os.fsync(self._file.fileno())
            self._end = entry.end
        return entry

    def _load(self) -> dict[str, Any] | None:
        """Take what can be taken and return the plan; None = not even that was written."""
        plan: dict[str, Any] | None = None
        for entry in self._chunks():
            try:
                if plan is None:
                    plan = _object(self._read(entry))
                else:
                    self._take(entry)
            except CorruptError:
                if plan is None:
                    raise OutputError(
                        f"{self.path} is damaged and cannot be resumed; "
                        "`overwrite=True` alone starts anew"
                    ) from None
                # What is damaged is done again.
        return plan

    def _chunks(self) -> Iterator[ChunkEntry]:
        """Yield the chunks up to the first whose head is damaged or which is cut short."""
        size = self._file.seek(0, os.SEEK_END)
        self._end = len(_SIGNATURE)
        while size - self._end >= OVERHEAD_BYTES:
            self._file.seek(self._end)
            try:
                entry = parse_chunk_head(self._file.read(HEAD_BYTES), self._end)
            except CorruptError:
                return
            if entry.end > size:
                return
            yield entry
            self._end = entry.end

    def _take(self, entry: ChunkEntry) -> None:
        payload = self._read(entry)
        if entry.type == _ANALYSIS:
            self._analysis = Analysis.from_json(_json(payload))
        elif entry.type == _SIZE:
            self._first_pass = plan_from_json(_json(payload))
        elif entry.type == _PART:
            gop, content = _split(payload)
            self._entries[gop.frames] = _Kept(gop, entry, len(content))

    def _read(self, entry: ChunkEntry) -> bytes:
        with self._lock:
            self._file.seek(entry.payload_offset)
            data = self._file.read(entry.end - entry.payload_offset)
        return check_payload(entry, data)


def _split(payload: bytes) -> tuple[EncodedGop, bytes]:
    """Return what a part is made of: a GOP without its payload, and the payload."""
    if len(payload) < _LENGTH.size:
        raise CorruptError("a part without its length")
    start = _LENGTH.size + _LENGTH.unpack_from(payload)[0]
    head = _object(payload[_LENGTH.size : start])
    match head:
        case {"frames": [int(first), int(end)], "figures": dict(figures)}:
            with suppress(TypeError):
                return EncodedGop(frames=range(first, end), **figures), payload[start:]
    raise CorruptError("a part that does not say what it is")


def _object(data: bytes) -> dict[str, Any]:
    value = _json(data)
    if not isinstance(value, dict):
        raise CorruptError("not a JSON object")
    return value


def _json(data: bytes) -> Any:
    try:
        return json.loads(data)
    except (ValueError, RecursionError) as error:
        raise CorruptError("not JSON") from error


def _differences(
    was: Mapping[str, Any], now: Mapping[str, Any], *, arguments: bool = False
) -> Iterator[str]:
    """Yield "name old, not new" for every leaf in which two plans differ.

    The names of settings are arguments.
    """
    for name in [*was, *(name for name in now if name not in was)]:
        old, new = was.get(name), now.get(name)
        if isinstance(old, dict) and isinstance(new, dict):
            yield from _differences(old, new, arguments=name == "settings")
        elif old != new:
            label = f"`{name}`" if arguments else name.replace("_", "-")
            yield f"{label} {old}, not {new}"
