"""Hostile bytes, guided by coverage: `python -m tests.fuzz_guided TARGET --seconds 300`.

Needs atheris, and clang's libFuzzer in it. It starts from `tests/corpus/TARGET` and the sound
inputs of `tests.fuzz_targets`, ends with an error at the first input that is not refused properly,
that takes too long or too much memory, and keeps it as `crash-...`. What it found is minimised and
replaces the corpus.
"""

from __future__ import annotations

import argparse
import importlib
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

CORPUS = Path(__file__).parent / "corpus"
#: Longest input, bytes; most memory, MB; most seconds for an input.
FLAGS = ("-max_len=4096", "-rss_limit_mb=2048", "-timeout=20", "-print_final_stats=1")


def main() -> None:
    """Fuzz one target for a time, then minimise."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition(":")[0])
    parser.add_argument("target")
    parser.add_argument("--seconds", type=int, default=60)
    parser.add_argument("--fuzz", nargs=argparse.REMAINDER, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.fuzz is not None:
        fuzz(options.target, options.fuzz)
        return
    kept = CORPUS / options.target
    kept.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        found, least = Path(folder) / "found", Path(folder) / "least"
        for path in (found, least):
            path.mkdir()
        write_seeds(options.target, found)
        again = (sys.executable, "-m", "tests.fuzz_guided", options.target, "--fuzz", *FLAGS)
        time = f"-max_total_time={options.seconds}"
        subprocess.run([*again, time, str(found), str(kept)], check=True)
        subprocess.run([*again, "-merge=1", str(least), str(found), str(kept)], check=True)
        shutil.rmtree(kept)
        shutil.copytree(least, kept)


def write_seeds(target: str, folder: Path) -> None:
    """Write the sound inputs of a target."""
    from tests import fuzz_targets

    for number, data in enumerate(fuzz_targets.seeds(target)):
        (folder / str(number)).write_bytes(data)


def fuzz(target: str, flags: list[str]) -> None:
    """Run libFuzzer in this process, which ends it."""
    atheris = importlib.import_module("atheris")
    with atheris.instrument_imports(include=["gsvrcodec"]):
        from gsvrcodec.errors import GsvrError
        from tests import fuzz_targets
    run = fuzz_targets.TARGETS[target]

    def one(data: bytes) -> None:
        try:
            run(data)
        except GsvrError:
            return

    # To minimise, libFuzzer starts itself again, by this command.
    command = f"{sys.executable} -m tests.fuzz_guided {target} --fuzz"
    atheris.Setup([command, *flags], one)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
