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


def test_a_clone_without_its_core_says_what_to_do() -> None:
    code = """
import sys
class Nowhere:
    def find_spec(self, name, *_):
        if name == "gsvrcodec.native._core":
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Nowhere())
import gsvrcodec
try:
    gsvrcodec.open
except ImportError as error:
    assert "is not built in" in str(error) and "pip install -e ." in str(error)
else:
    raise AssertionError
"""
    loaded_by(code)


ROOT = Path(__file__).parent.parent
WHOLE, DECODER = (
    tomllib.loads((ROOT / folder / "pyproject.toml").read_text())["project"]
    for folder in ("", "packaging/decoder")
)


def test_both_distributions_are_of_this_version() -> None:
    assert gsvrcodec.__version__ == WHOLE["version"] == DECODER["version"]
    assert set(DECODER["dependencies"]) < set(WHOLE["dependencies"])
    assert DECODER["scripts"].items() < WHOLE["scripts"].items()


def test_decoding_without_the_encoder(tmp_path: Path) -> None:
    """What the decoder's distribution leaves out cannot be imported here."""
    path = making.gsvr_file(tmp_path / "a.gsvr")
    code = f"""
import sys
class Nowhere:
    def find_spec(self, name, *_):
        if name in ("torch", "cv2", "gsvrcodec.encoder", "gsvrcodec.fit", "gsvrcodec.dataset"):
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path.insert(0, Nowhere())
import gsvrcodec
from gsvrcodec.cli import dec, info, play
with gsvrcodec.open({str(path)!r}) as decoder:
    assert decoder[3].data.any()
assert dec.main([{str(path)!r}, {str(tmp_path / "out.mp4")!r}]) == 0
assert info.main(["--verify", {str(path)!r}]) == 0
assert play.main([{str(path)!r}, "--export", {str(tmp_path / "out.html")!r}]) == 0
for name in ("encode", "ClipDataset"):
    try:
        getattr(gsvrcodec, name)
    except ModuleNotFoundError as error:
        assert "which gsvrcodec-decoder comes without" in str(error)
    else:
        raise AssertionError(name)
"""
    assert loaded_by(code).isdisjoint({"torch", "cv2"})


def test_without_pytorch(tmp_path: Path) -> None:
    """All but tensors, clips of them and GPUs, which say what they need."""
    path = tmp_path / "a.gsvr"
    code = f"""
import sys
class Nowhere:
    def find_spec(self, name, *_):
        if name in ("torch", "triton"):
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path.insert(0, Nowhere())
import gsvrcodec
from gsvrcodec.cli import dec, enc, report
options = ["--preset", "fastest", "--profile"]
for profile in ("paper", "main"):
    assert enc.main(["-y", {str(making.NOISE)!r}, {str(path)!r}, *options, profile]) == 0
assert dec.main([{str(path)!r}, {str(tmp_path / "out.mp4")!r}]) == 0
assert report.main([{str(making.NOISE)!r}, {str(path)!r}]) == 0
for needy in (
    lambda: gsvrcodec.ClipDataset({str(path)!r}),
    lambda: gsvrcodec.open({str(path)!r}, tensors=True)[0],
    lambda: gsvrcodec.open({str(path)!r})[0].tensor,
):
    try:
        needy()
    except (gsvrcodec.errors.UsageError, ModuleNotFoundError) as error:
        assert str(error).endswith("pip install torch")
    else:
        raise AssertionError
"""
    assert loaded_by(code).isdisjoint({"torch", "triton"})


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
