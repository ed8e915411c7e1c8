"""A copy of the package with native modules of another build, and the project's tests in it."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path

from tests.cmake_build import ROOT

#: What Python runs in the copy, followed by options of pytest. The hook of an editable install
#: would load the installed package.
RUN_PYTEST = """
import sys
sys.path.insert(0, ".")
sys.meta_path[:] = [f for f in sys.meta_path if "Redirecting" not in type(f).__name__]
import pytest
from gsvrcodec.native import _core
from pathlib import Path
assert Path(_core.__file__).is_relative_to(Path.cwd()), _core.__file__
sys.exit(pytest.main(["-q", "-n0", "-p", "no:cacheprovider", *sys.argv[1:]]))
"""


def stage(modules: Mapping[str, Path], folder: Path) -> None:
    """Put package, tests, samples and specification into `folder`, with these native modules."""
    for name in ("gsvrcodec", "tests", "samples", "spec"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("*.so"))
    shutil.copy(ROOT / "pyproject.toml", folder)
    for name, module in modules.items():
        shutil.copy(module, folder / "gsvrcodec" / "native" / f"{name}.so")
