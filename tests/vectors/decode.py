"""Decodes the vectors as `check` wants them: `python -m tests.vectors.decode FOLDER`."""

from __future__ import annotations

import json
from fractions import Fraction
from pathlib import Path

import click
import imagecodecs
import numpy as np

import gsvrcodec
from gsvrcodec.bitstream.reader import GsvrReader
from gsvrcodec.render.backend import Codes
from tests.vectors.description import Picture, gops_of
from tests.vectors.make import VALID


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--device", default="cpu", show_default=True, help="Device that renders.")
def main(folder: Path, device: str) -> None:
    """Write values and pictures of all vectors into FOLDER."""
    folder.mkdir(exist_ok=True)
    for path in sorted(VALID.glob("*.gsvr")):
        decode(path, folder, device)


def decode(path: Path, folder: Path, device: str = "cpu") -> None:
    """Write what is in a vector, and the pictures that its description names."""
    with GsvrReader(path) as reader:
        (folder / f"{path.stem}.json").write_text(json.dumps({"gops": gops_of(reader)}))
    for wanted in json.loads(path.with_suffix(".json").read_text())["pictures"]:
        picture = Picture(**wanted)
        with gsvrcodec.open(path, bit_depth=picture.bits, device=device) as decoder:
            seconds = Fraction(picture.time) * decoder.metadata.time_base
            codes = decoder.render(seconds, (picture.width, picture.height))
        write_picture(folder / picture.file, codes)


def write_picture(path: Path, codes: Codes) -> None:
    """Write codes (H, W, 3), uint8 or uint16, as a PNG."""
    path.write_bytes(imagecodecs.png_encode(np.ascontiguousarray(codes)))


if __name__ == "__main__":
    main()
