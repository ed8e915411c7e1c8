"""Arrows between the packages point down only, and each library has its place."""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "gsvrcodec"

#: Each package or top-level module, from the bottom up, and what it may import. A line may only
#: name what stands above it, so there is no way round in a circle.
ALLOWED: dict[str, set[str]] = {
    "ahead": set(),
    "errors": set(),
    "limits": {"errors"},
    "files": {"errors"},
    "metrics": {"numpy", "cv2"},
    "native": {"numpy"},
    "model": {"errors", "native", "numpy"},
    "planes": {"errors", "limits", "native", "numpy", "imagecodecs", "av", "PIL"},
    "bitstream": {"errors", "limits", "native", "model", "planes", "numpy", "fsspec"},
    "play": {"errors", "files", "bitstream"},
    "render": {"errors", "model", "native", "numpy", "torch", "triton"},
    "video": {"errors", "limits", "files", "bitstream", "numpy", "av"},
    "versions": {"bitstream", "native", "video"},
    "fit": {
        "errors",
        "metrics",
        "model",
        "native",
        "render",
        "numpy",
        "torch",
        "torchvision",
        "cv2",
    },
    "decoder": {"ahead", "errors", "limits", "bitstream", "model", "render", "video", "numpy"},
    "dataset": {"errors", "limits", "bitstream", "decoder", "torch"},
    "encoder": {
        *(
            "ahead",
            "errors",
            "limits",
            "files",
            "metrics",
            "versions",
            "model",
            "planes",
            "bitstream",
            "native",
        ),
        *("render", "video", "fit", "decoder", "numpy", "cv2"),
        *("imagecodecs", "dask", "distributed"),
    },
    "report": {
        *("errors", "limits", "metrics", "model", "bitstream", "video", "decoder"),
        *("numpy", "matplotlib"),
    },
    "cli": {
        *("errors", "limits", "files", "versions", "model", "bitstream", "video"),
        *("decoder", "encoder", "fit", "report", "play", "click", "rich"),
    },
}

#: The backend for GPUs.
_TRITON = {path.name for path in PACKAGE.glob("render/triton/*.py")}

#: Modules of a package that may import what the rest of it may not.
ONLY_IN = {
    ("bitstream", "numpy"): {
        *("attribute_planes.py", "gop_chain.py", "gop_payload.py"),
        *("refinement_bits.py", "timing.py"),
    },
    ("bitstream", "fsspec"): {"source.py"},
    ("model", "native"): {"gop.py", "prediction.py", "quantise.py"},
    ("bitstream", "native"): {"refinement_bits.py"},
    ("render", "torch"): {
        *("__init__.py", "reference.py", "device.py"),
        *_TRITON,
    },
    ("render", "triton"): _TRITON,
    ("decoder", "video"): {"export.py"},
    ("encoder", "cv2"): {"analysis.py", "paths.py"},
    ("encoder", "decoder"): {"output.py"},
    ("encoder", "imagecodecs"): {"source.py"},
    ("encoder", "dask"): {"dask.py"},
    ("encoder", "distributed"): {"dask.py"},
    ("planes", "PIL"): {"avif.py"},
    ("report", "matplotlib"): {"plot.py"},
    ("fit", "torch"): {"motion.py"},
    ("fit", "torchvision"): {"motion.py"},
    ("cli", "encoder"): {"enc.py", "progress.py"},
    ("cli", "fit"): {"enc.py"},
}


def sources() -> Iterator[tuple[str, Path]]:
    """Yield the package or module that each file belongs to; the public face stands aside."""
    for path in sorted(PACKAGE.rglob("*.py")):
        part = path.relative_to(PACKAGE).with_suffix("").parts[0]
        if part != "__init__":
            yield part, path


def imports(path: Path) -> Iterator[str]:
    """Yield the packages and libraries that a module imports, at the top or later."""
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path} imports relative to itself"
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        else:
            continue
        for name in names:
            top, _, rest = name.partition(".")
            if top == "gsvrcodec":
                yield rest.partition(".")[0]
            elif top not in sys.stdlib_module_names:
                yield top


def test_every_package_has_its_line() -> None:
    assert {part for part, _ in sources()} == set(ALLOWED)


def test_arrows_point_down() -> None:
    parts = list(ALLOWED)
    for position, (part, allowed) in enumerate(ALLOWED.items()):
        below = set(parts[position:]) & allowed
        assert not below, f"{part} may not know {below}"


@pytest.mark.parametrize("part", ALLOWED)
def test_imports_are_allowed(part: str) -> None:
    for owner, path in sources():
        if owner != part:
            continue
        for name in imports(path):
            # The public face is what may be asked for the version.
            if name in (part, "") or (part == "versions" and name == "__version__"):
                continue
            assert name in ALLOWED[part], f"{path.name} of {part} imports {name}"
            assert path.name in ONLY_IN.get((part, name), {path.name}), f"{path.name}: {name}"


def test_options_belong_to_the_commands() -> None:
    """The library has arguments; `gsvrcodec.cli` spells them as options where it prints them."""
    option = re.compile(r"(?<![\w-])(?:--[a-z]|-y\b)")
    for part, path in sources():
        if part == "cli":
            continue
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                assert not option.search(node.value), f"{path}, line {node.lineno}: {node.value}"


def test_few_modules_stand_at_the_top() -> None:
    top = {path.name for path in PACKAGE.glob("*.py")} - {"__init__.py"}
    assert len(top) <= 8
