"""Clusters for tests: a scheduler and workers on the loopback, each a process of its own.

And the executors of docs/cluster.md.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).parent.parent.parent
Process = subprocess.Popen[bytes]


@dataclass(frozen=True)
class Machines:
    """A cluster that runs."""

    address: str
    file: Path  #: that has the address, as `dask scheduler` writes it
    scheduler: Process
    workers: list[Process]


@contextmanager
def machines(
    workers: int, *, threads: int = 1, environment: Mapping[str, str] | None = None
) -> Iterator[Machines]:
    """Start a scheduler and so many workers, which have more in their environment; kill them all.

    Workers may still be about to join when the block begins.
    """
    variables = {**os.environ, "PYTHONPATH": str(ROOT), **(environment or {})}
    started: list[Process] = []

    def start(program: str, *args: str) -> Process:
        # Dask's own command lines, as `dask scheduler` and `dask worker`; -P: not our directory.
        command = [sys.executable, "-P", "-m", f"distributed.cli.dask_{program}", *args]
        quiet = subprocess.DEVNULL
        started.append(subprocess.Popen(command, env=variables, stdout=quiet, stderr=quiet))
        return started[-1]

    with TemporaryDirectory() as directory:
        file = Path(directory) / "scheduler.json"
        try:
            scheduler = start(
                *("scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard"),
                *("--scheduler-file", str(file)),
            )
            address = None
            while address is None:
                assert scheduler.poll() is None, "the scheduler has ended"
                time.sleep(0.05)
                with suppress(OSError, ValueError):
                    address = json.loads(file.read_text())["address"]
            options = [
                *("--no-nanny", "--no-dashboard", "--memory-limit", "0"),
                *("--nthreads", str(threads), "--local-directory", directory),
            ]
            crew = [start("worker", address, *options) for _ in range(workers)]
            yield Machines(address, file, scheduler, crew)
        finally:
            for process in started:
                process.kill()
                process.wait()


def example(package: str) -> str:
    """Return the example of docs/cluster.md that imports this package beside gsvrcodec."""
    page = (ROOT / "docs" / "cluster.md").read_text("utf-8")
    section = page.partition("## Other executors")[2]
    blocks = re.findall(r"^```python\n(.*?)^```$", section, re.MULTILINE | re.DOTALL)
    imports = re.compile(rf"^(import|from) {package}\b", re.MULTILINE)
    (found,) = (block for block in blocks if imports.search(block))
    return str(found)
