"""Time and size of each way to install: `python -m tests.benchmarks.install --json FILE.json`.

Each is installed into an environment of its own, with the packages of constraints.txt; the time is
without the download where pip has them already.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import click

from tests.benchmarks.machine import command, machine

ROOT = Path(__file__).parents[2]

#: What is installed, and how.
WAYS = {
    "all of it": ("-e", "."),
    "the decoder alone": ("./packaging/decoder",),
}


def megabytes(folder: Path) -> float:
    """Return the size of all files in a folder."""
    return sum(path.lstat().st_size for path in folder.rglob("*") if path.is_file()) / 1e6


@click.command()
@click.option("--json", "output", type=click.Path(path_type=Path), help="Write the figures here.")
def main(output: Path | None) -> None:
    """Install in every way."""
    rows = []
    for name, arguments in WAYS.items():
        with tempfile.TemporaryDirectory() as folder:
            subprocess.run([sys.executable, "-m", "venv", folder], check=True)
            empty, began = megabytes(Path(folder)), time.perf_counter()
            pip = [f"{folder}/bin/pip", "install", "-q", "-c", "constraints.txt", *arguments]
            subprocess.run(pip, check=True, cwd=ROOT, stderr=subprocess.DEVNULL)
            seconds = time.perf_counter() - began
            size = megabytes(Path(folder)) - empty
        rows.append({"way": name, "seconds": round(seconds), "megabytes": round(size)})
        print(f"{name:32}{seconds:6.0f} s{size:8.0f} MB", flush=True)
    if output is not None:
        about = {"machine": machine(), "command": command("tests.benchmarks.install")}
        output.write_text(json.dumps(about | {"rows": rows}, indent=1) + "\n")


if __name__ == "__main__":
    sys.exit(main())
