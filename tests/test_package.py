"""The public face: names, and what importing and decoding may not load."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import gsvrcodec
from tests import making

HEAVY = ("torch", "cv2", "torchvision", "matplotlib", "rich")


def loaded_by(code: str) -> set[str]:
    """Return the top-level modules that a fresh interpreter has loaded after `code`."""
    listing = "\nimport sys; print(*{name.partition('.')[0] for name in sys.modules})"
    run = subprocess.run(
        [sys.executable, "-c", code + listing], capture_output=True, text=True, check=True
    )
    return set(run.stdout.splitlines()[-1].split())


def test_every_public_name_is_there() -> None:
    for name in gsvrcodec.__all__:
        assert getattr(gsvrcodec, name) is not None
    assert set(gsvrcodec.__all__) <= set(dir(gsvrcodec))


def test_unknown_name_fails() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'opne'"):
        gsvrcodec.opne  # noqa: B018


def test_functions_are_not_hidden_by_their_modules() -> None:
    code = """
import gsvrcodec
from gsvrcodec.decoder.decoder import Decoder
from gsvrcodec.encoder.progress import Progress
assert callable(gsvrcodec.decode) and callable(gsvrcodec.encode)
"""
    assert "gsvrcodec" in loaded_by(code)


def test_version_is_that_of_the_distribution() -> None:
    project = tomllib.loads((Path(__file__).parent.parent / "pyproject.toml").read_text())
    assert gsvrcodec.__version__ == project["project"]["version"]


def test_import_is_light() -> None:
    assert loaded_by("import gsvrcodec").isdisjoint({*HEAVY, "numpy", "av", "click"})


def test_decoding_is_light(tmp_path: Path) -> None:
    path = making.gsvr_file(tmp_path / "a.gsvr")
    code = f"""
import gsvrcodec
with gsvrcodec.open({str(path)!r}) as decoder:
    assert decoder[3].data.any()
gsvrcodec.decode({str(path)!r}, {str(tmp_path / "out.mp4")!r})
"""
    assert loaded_by(code).isdisjoint(HEAVY)
