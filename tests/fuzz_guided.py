"""Hostile files, guided by coverage: `python -m tests.fuzz_guided --seconds 60`, needs atheris.

It ends with an error at the first input that is not refused properly, and keeps it as `crash-...`.
"""

from __future__ import annotations

import argparse
import importlib
import sys
import tempfile
from pathlib import Path

atheris = importlib.import_module("atheris")
with atheris.instrument_imports(include=["gsvrcodec"]):
    from tests import fuzz


def one(data: bytes) -> None:
    """Try one input, with its checksums made right."""
    fuzz.outcome(fuzz.repaired(data), None)


def main() -> None:
    """Fuzz for a time; libFuzzer prints how far it has come, and ends the process."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition(":")[0])
    parser.add_argument("--seconds", type=int, default=60)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as corpus:
        for number, data in enumerate(fuzz.seeds()):
            (Path(corpus) / str(number)).write_bytes(data)
        limits = f"-max_total_time={options.seconds}", f"-timeout={round(10 * fuzz.PATIENCE)}"
        flags = [*limits, "-max_len=8192", "-print_final_stats=1", "-verbosity=1"]
        atheris.Setup([sys.argv[0], corpus, *flags], one)
        atheris.Fuzz()


if __name__ == "__main__":
    main()
