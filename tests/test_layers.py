"""Arrows between the parts of the package point down only, and each library has its place."""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "gsvrcodec"

#: Each part, from the bottom up, and the parts and libraries that it may import. A part may only
#: name those above its own line, so there is no way round in a circle.
ALLOWED: dict[str, set[str]] = {
    "errors": set(),
    "limits": {"errors"},
    "files": {"errors"},
    "metrics": {"numpy", "cv2"},
    "native": {"numpy"},
    "container": {"errors", "limits"},
    "planes": {"errors", "limits", "native", "numpy", "imagecodecs"},
    "model": {"errors", "limits", "container", "planes", "numpy"},
    "render": {"errors", "model", "native", "numpy", "torch", "triton"},
    "video": {"errors", "limits", "files", "container", "numpy", "av"},
    "fit": {
        "errors",
        "limits",
        "metrics",
        "planes",
        "model",
        "native",
        "render",
        "numpy",
        "torch",
        "torchvision",
        "cv2",
    },
    "frames": {"errors", "limits", "container", "numpy"},
    "gops": {"errors", "limits", "container", "model", "numpy"},
    "pictures": {"errors", "limits", "model", "render", "numpy"},
    "decode": {
        "errors",
        "limits",
        "container",
        "model",
        "render",
        "pictures",
        "frames",
        "gops",
        "numpy",
    },
    "parts": {"errors", "files", "container"},
    "results": {"parts"},
    "versions": {"container", "native", "video"},
    "workers": {"errors", "fit", "native"},
    "tasks": {"errors", "limits", "model", "fit", "parts", "video", "workers", "numpy"},
    "verify": {"errors", "metrics", "video", "decode", "numpy"},
    "encode": {
        "errors",
        "files",
        "container",
        "fit",
        "render",
        "video",
        "parts",
        "results",
        "versions",
        "tasks",
        "workers",
        "verify",
    },
    "schedule": {"errors", "frames", "decode"},
    "transcode": {"errors", "limits", "model", "video", "pictures", "schedule", "decode"},
    "report": {
        "errors",
        "limits",
        "metrics",
        "container",
        "model",
        "video",
        "frames",
        "decode",
        "numpy",
        "matplotlib",
    },
    "cli": {
        "errors",
        "files",
        "container",
        "model",
        "video",
        "fit",
        "results",
        "versions",
        "encode",
        "transcode",
        "report",
        "click",
        "rich",
    },
}

#: The backend for GPUs.
_TRITON = {path.name for path in PACKAGE.glob("render/triton/*.py")}

#: Modules of a part that may import a library which the rest of the part may not.
ONLY_IN = {
    ("render", "torch"): {"reference.py", "device.py", *_TRITON},
    ("render", "triton"): _TRITON,
    ("report", "matplotlib"): {"plot.py"},
    ("fit", "torchvision"): {"flow.py"},
    ("cli", "fit"): {"enc.py"},
}


def sources() -> Iterator[tuple[str, Path]]:
    """Yield the part that each module belongs to, and its file; the public face stands aside."""
    for path in sorted(PACKAGE.rglob("*.py")):
        part = path.relative_to(PACKAGE).with_suffix("").parts[0]
        if part != "__init__":
            yield part, path


def imports(path: Path) -> Iterator[str]:
    """Yield the parts and libraries that a module imports, at the top or later."""
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


def test_every_part_has_its_line() -> None:
    assert {part for part, _ in sources()} == set(ALLOWED)


def test_arrows_point_down() -> None:
    parts = list(ALLOWED)
    for position, (part, allowed) in enumerate(ALLOWED.items()):
        above = set(parts[position:]) & allowed
        assert not above, f"{part} may not know {above}"


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
            assert path.name in ONLY_IN.get((part, name), {path.name})
