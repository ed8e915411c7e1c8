"""Writes the test vectors again: `python -m tests.vectors.make [NAME]...`.

Planes coded by PNG, JPEG XL or deflate may come out as other bytes with other versions of the
libraries, and films with other Gaussians; what is in a file then differs from its description
before. Vectors are written again only when the format changes.
"""

from __future__ import annotations

import io
import json
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import click
import imagecodecs

from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.cli import dec, info
from gsvrcodec.render.reference import ReferenceBackend
from tests.vectors.description import description, pictures_of, render
from tests.vectors.faults import faulty_vectors
from tests.vectors.streams import STREAMS

HERE = Path(__file__).parent
VALID = HERE / "valid"
PICTURES = VALID / "pictures"
FAULTY = HERE / "faulty"

#: The tools that a faulty file is given to.
TOOLS = ("gsvrdec", "gsvrdec --keep-going", "gsvrinfo --verify")


@click.command()
@click.argument("names", nargs=-1, type=click.Choice(sorted(STREAMS)))
def main(names: Sequence[str]) -> None:
    """Write the streams NAMES, or all of them and the faulty files too."""
    for name in names or STREAMS:
        data = STREAMS[name]()
        (VALID / f"{name}.gsvr").write_bytes(data)
        describe(name)
        print(name, len(data))
    if not names:
        write_faulty()


def describe(name: str) -> None:
    """Write what is in a stream, and its pictures in binary64."""
    path = VALID / f"{name}.gsvr"
    found = json.dumps(description(name, path.read_bytes()), indent=1)
    path.with_suffix(".json").write_text(found + "\n")
    with GsvrReader(path) as reader:
        for picture in pictures_of(name, reader):
            codes = render(reader, picture, ReferenceBackend(reader.header.blending))
            (PICTURES / picture.file).write_bytes(imagecodecs.png_encode(codes, level=9))


def write_faulty() -> None:
    """Write the faulty files, and what the tools make of them."""
    expected = {}
    for fault in faulty_vectors():
        path = FAULTY / f"{fault.name}.gsvr"
        path.write_bytes(fault.data)
        codes, said = taken(path)
        if not any(fault.says in line for line in said):
            raise ValueError(f"{fault.name}: {fault.says!r} is not in {said}")
        expected[fault.name] = {**dict(zip(TOOLS, codes, strict=True)), "says": fault.says}
    lines = [f"{json.dumps(name)}: {json.dumps(value)}" for name, value in expected.items()]
    (FAULTY / "expected.json").write_text("{\n" + ",\n".join(lines) + "\n}\n")


def taken(path: Path) -> tuple[list[int], list[str]]:
    """Exit codes of `TOOLS` for a file, and what they say on standard error."""
    runs = list(_runs(path))
    return [code for code, _ in runs], [said for _, said in runs]


def _runs(path: Path) -> Iterator[tuple[int, str]]:
    with tempfile.TemporaryDirectory() as folder:
        film = str(Path(folder) / "film.y4m")
        common = ["-q", "-y", "--device", "cpu", "--threads", "1", str(path), film]
        for main, arguments in (
            (dec.main, common),
            (dec.main, ["--keep-going", *common]),
            (info.main, ["--verify", str(path)]),
        ):
            said = io.StringIO()
            with redirect_stderr(said), redirect_stdout(io.StringIO()):
                code = main(arguments)
            yield code, said.getvalue()


if __name__ == "__main__":
    main()
