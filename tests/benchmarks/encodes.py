"""One encode of a benchmark: run by itself, decoded from its file, and measured."""

from __future__ import annotations

import json
import os
import threading
import time
from collections.abc import Iterable, Mapping
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from dataclasses import asdict, dataclass
from multiprocessing import get_context
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import gsvrcodec
from gsvrcodec.report.compare import report
from gsvrcodec.report.inspect import inspect_bytes
from tests.benchmarks.machine import command, commit, machine

#: Of the files that are measured.
BITSTREAM = "1.0-rc4"
#: Between two looks at the memory in use, seconds.
_INTERVAL = 0.2


@dataclass(frozen=True, slots=True)
class Row:
    """One encode, measured from its file."""

    table: str
    clip: str  #: name of the source
    size: tuple[int, int]  #: width and height, pixels
    frames: int
    settings: dict[str, Any]  #: what differs from the table's other rows
    psnr: float  #: dB, mean of the frames
    psnr_min: float  #: dB, worst frame
    float_psnr: float  #: dB, mean of the frames before quantisation
    ssim: float | None
    ms_ssim: float | None
    bpp: float
    gops: int
    gaussians: int
    bits_per_gaussian: dict[str, float | None]  #: by attribute, and for the rest of the file
    seconds_per_frame: float  #: wall time of the whole encode
    memory: int | None  #: peak of the encode with all its processes, bytes; None = not known
    psnr_gops: tuple[float, ...]  #: dB, mean of the frames of each GOP


class MemoryWatch:
    """The most memory that this process and those it started hold while the block runs."""

    def __init__(self) -> None:
        self.peak: int | None = None
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._done.set()
        self._thread.join()

    def _watch(self) -> None:
        finished = False
        while not finished:
            finished = self._done.wait(_INTERVAL)
            now = sum(map(_memory, _family(os.getpid())))
            if now:
                self.peak = max(now, self.peak or 0)


def _family(pid: int) -> Iterable[int]:
    """A process and all that it started, directly or not."""
    yield pid
    with suppress(OSError):
        for task in Path(f"/proc/{pid}/task").iterdir():
            for child in (task / "children").read_text().split():
                yield from _family(int(child))


def _memory(pid: int) -> int:
    """Bytes that a process holds, shared pages in shares; 0 = it is gone, or not known."""
    with suppress(OSError):
        for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines():
            if line.startswith("Pss:"):
                return 1024 * int(line.split()[1])
    return 0


def measure(
    table: str,
    source: Path,
    path: Path,
    settings: Mapping[str, Any],
    common: Mapping[str, Any],
) -> Row:
    """Encode `source` as `path` in a process of its own and compare the file with the source."""
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        return pool.submit(_measure, table, source, path, dict(settings), dict(common)).result()


def _measure(
    table: str, source: Path, path: Path, settings: dict[str, Any], common: dict[str, Any]
) -> Row:
    with MemoryWatch() as watch:
        start = time.perf_counter()
        result = gsvrcodec.encode(source, path, overwrite=True, **(common | settings))
        seconds = time.perf_counter() - start
    quality = report(source, path)
    return Row(
        table=table,
        clip=source.name,
        size=(quality.width, quality.height),
        frames=result.frames,
        settings=settings,
        psnr=quality.psnr_rgb,
        psnr_min=quality.psnr_rgb_min,
        float_psnr=result.float_psnr,
        ssim=quality.ssim,
        ms_ssim=quality.ms_ssim,
        bpp=quality.bpp,
        gops=result.gops,
        gaussians=result.gaussians,
        bits_per_gaussian={item.name: item.bits_per_gaussian for item in inspect_bytes(path)},
        seconds_per_frame=seconds / result.frames,
        memory=watch.peak,
        psnr_gops=tuple(gop.psnr for gop in result.gop_stats),
    )


HEADING = f"{'':34}{'PSNR':>7}{'worst':>7}{'float':>7}{'bpp':>8}{'GOPs':>5}{'s/frame':>8}{'GB':>5}"


def show(row: Row, name: str | None = None) -> None:
    """Print a row below `HEADING`."""
    if name is None:
        name = ", ".join(f"{key} {value}" for key, value in row.settings.items())
    memory = "-" if row.memory is None else f"{row.memory / 1e9:.1f}"
    print(
        f"{name[:34]:34}{row.psnr:7.2f}{row.psnr_min:7.2f}{row.float_psnr:7.2f}{row.bpp:8.4f}"
        f"{row.gops:5}{row.seconds_per_frame:8.2f}{memory:>5}",
        flush=True,
    )


def document(module: str, common: Mapping[str, Any], rows: Iterable[Any]) -> dict[str, Any]:
    """What a benchmark leaves behind: what ran where, and what came out, a dataclass a row."""
    return {
        "machine": machine(),
        "commit": commit(),
        "bitstream": BITSTREAM,
        "load": os.getloadavg()[0],
        "command": command(module),
        "common": dict(common),
        "rows": [asdict(row) for row in rows],
    }


def save(path: Path, content: Mapping[str, Any]) -> None:
    """Write a result as JSON."""
    path.write_text(json.dumps(content, indent=1) + "\n")
