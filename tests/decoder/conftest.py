"""The film as a file, open, and decoded in order."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

import pytest

import gsvrcodec
from gsvrcodec import Decoder, Frame
from tests import making
from tests.decoder.film import GOPS, TIMES


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return making.gsvr_file(
        tmp_path_factory.mktemp("decode") / "a.gsvr",
        frames=GOPS,
        times=TIMES,
        time_base=Fraction(1, 90_000),
        settings={"seed": 7},
        rotation=90,
    )


@pytest.fixture
def decoder(path: Path) -> Iterator[Decoder]:
    with gsvrcodec.open(path) as decoder:
        yield decoder


@pytest.fixture(scope="module")
def sequence(path: Path) -> list[Frame]:
    with gsvrcodec.open(path) as decoder:
        return list(decoder)
