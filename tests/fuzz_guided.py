"""Hostile bytes, guided by coverage: `python -m tests.fuzz_guided TARGET --seconds 300`.

Needs atheris, and clang's libFuzzer in it. It starts from `tests/corpus/TARGET.zip` and the sound
inputs of `tests.fuzz_targets`, ends with an error at the first input that is not refused properly,
that takes too long or too much memory, and keeps it as `crash-...`. What it found is minimised and
replaces the corpus.
"""

from __future__ import annotations

import argparse
import importlib
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterable, Iterator
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
    from tests import fuzz_targets

    with tempfile.TemporaryDirectory() as folder:
        kept, found, least = (Path(folder) / name for name in ("kept", "found", "least"))
        for path in (kept, found, least):
            path.mkdir()
        write(kept, kept_inputs(options.target))
        write(found, fuzz_targets.seeds(options.target))
        again = (sys.executable, "-m", "tests.fuzz_guided", options.target, "--fuzz", *FLAGS)
        time = f"-max_total_time={options.seconds}"
        subprocess.run([*again, time, str(found), str(kept)], check=True)
        subprocess.run([*again, "-merge=1", str(least), str(found), str(kept)], check=True)
        keep(options.target, least)


def kept_inputs(target: str) -> Iterator[bytes]:
    """Yield the inputs that were found for a target."""
    path = CORPUS / f"{target}.zip"
    if path.exists():
        with zipfile.ZipFile(path) as archive:
            yield from map(archive.read, archive.namelist())


def keep(target: str, folder: Path) -> None:
    """Put the inputs of a folder in place of those that were found before."""
    with zipfile.ZipFile(CORPUS / f"{target}.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted(folder.iterdir()):
            # Without a time, so that the same inputs are the same archive.
            archive.writestr(zipfile.ZipInfo(path.name), path.read_bytes(), zipfile.ZIP_DEFLATED)


def write(folder: Path, inputs: Iterable[bytes]) -> None:
    """Write inputs as files."""
    for number, data in enumerate(inputs):
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
