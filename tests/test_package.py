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
    for name in set(gsvrcodec.__all__) - {"__version__", "errors"}:
        value = getattr(gsvrcodec, name)
        assert value.__name__ == name
        assert value.__module__.startswith("gsvrcodec.")
    assert gsvrcodec.errors.GsvrError.__module__ == "gsvrcodec.errors"


def test_names_are_listed_before_they_are_loaded() -> None:
    code = """
import gsvrcodec
assert "Decoder" not in vars(gsvrcodec)
print(*dir(gsvrcodec))
"""
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert set(gsvrcodec.__all__) <= set(run.stdout.split())


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
