"""Compares a decoder's output with the vectors: `python -m tests.vectors.check FOLDER`.

FOLDER holds NAME.json for each valid/NAME.gsvr, with timing and hashes of all GOPs, and the
pictures that valid/NAME.json names. README.md describes both. The limits are those of the spec,
section "Conformance".
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
import imagecodecs
import numpy as np
from numpy.typing import NDArray

VALID = Path(__file__).parent / "valid"

#: Samples of a picture that may differ by one code: a fraction of all, and so many more.
SHARE = 0.002
MORE = 16


@click.command()
@click.argument("folder", type=click.Path(path_type=Path, exists=True, file_okay=False))
def main(folder: Path) -> None:
    """Compare what a decoder wrote into FOLDER with the vectors; exit code 1 if it differs."""
    wrong = 0
    for path in sorted(VALID.glob("*.json")):
        faults = list(differences(path, folder))
        print(f"{path.stem}: {'; '.join(faults) or 'pass'}")
        wrong += bool(faults)
    print(f"{wrong} vectors differ" if wrong else "pass")
    sys.exit(bool(wrong))


def differences(path: Path, folder: Path) -> Iterator[str]:
    """Yield what differs from the description at `path`."""
    wanted = json.loads(path.read_text())
    try:
        found = json.loads((folder / path.name).read_text())
        yield from _of_gops(found["gops"], wanted["gops"])
    except FileNotFoundError:
        yield f"no {path.name}"
    except (ValueError, KeyError, TypeError) as error:
        yield f"{path.name} is not as described: {error!r}"
    for picture in wanted["pictures"]:
        name = picture["file"]
        try:
            codes = imagecodecs.png_decode((folder / name).read_bytes())
        except FileNotFoundError:
            yield f"no {name}"
        except imagecodecs.PngError as error:
            yield f"{name} is no PNG: {error}"
        else:
            yield from picture_differences(name, codes, read_picture(name))


def read_picture(name: str) -> NDArray[np.integer]:
    """The codes of an expected picture, (H, W, 3)."""
    codes: NDArray[np.integer] = imagecodecs.png_decode((VALID / "pictures" / name).read_bytes())
    return codes


def _of_gops(found: list[dict[str, Any]], wanted: list[dict[str, Any]]) -> Iterator[str]:
    if len(found) != len(wanted):
        yield f"{len(found)} GOPs, expected {len(wanted)}"
        return
    for number, (one, other) in enumerate(zip(found, wanted, strict=True)):
        for key in ("first_frame", "reference", "pts", "durations"):
            if one[key] != other[key]:
                yield f"GOP {number}: {key} {one[key]}, expected {other[key]}"
        values, expected = one["values"], other["values"]
        if values.keys() != expected.keys():
            yield f"GOP {number}: attributes {', '.join(values)}, expected {', '.join(expected)}"
        for name in values.keys() & expected.keys():
            if values[name] != expected[name]:
                yield f"GOP {number}: other values of {name}"


def picture_differences(
    name: str, found: NDArray[np.integer], wanted: NDArray[np.integer]
) -> Iterator[str]:
    """Yield what of a picture is over the limits."""
    if (found.shape, found.dtype) != (wanted.shape, wanted.dtype):
        yield (
            f"{name} has shape {found.shape} of {found.dtype}, expected {wanted.shape} of "
            f"{wanted.dtype}"
        )
        return
    difference = np.abs(found.astype(int) - wanted)
    if difference.max() > 1:
        yield f"{name} differs by up to {difference.max()} codes"
    differing = np.count_nonzero(difference)
    if differing > (allowed := int(SHARE * wanted.size) + MORE):
        yield f"{name} differs in {differing} of {wanted.size} samples, {allowed} are allowed"


if __name__ == "__main__":
    main()
