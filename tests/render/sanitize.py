"""Tests of the renderer on a core built with AddressSanitizer and UndefinedBehaviorSanitizer.

`python -m tests.render.sanitize [BUILD_FOLDER] [-- PYTEST OPTIONS]` builds it (about a minute; with
a folder that is kept, only what has changed), puts it into a copy of the package and runs the tests
there. Needs g++, cmake, ninja and nanobind; the sanitizers' libraries are preloaded, since Python
itself is built without them.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from gsvrcodec.native import _entropy
from tests.cmake_build import ROOT, build

#: Tests of the core alone: no interpreted kernels, which are slow, and no processes of their own.
_TESTS = [f"tests/render/test_{name}.py" for name in ("agreement", "robustness", "adam")]
#: Runs pytest on the staged package: the hook of an editable install would load the installed one.
_RUN = """
import sys
sys.path.insert(0, ".")
sys.meta_path[:] = [f for f in sys.meta_path if "Redirecting" not in type(f).__name__]
import pytest
from gsvrcodec.native import _core
from pathlib import Path
assert Path(_core.__file__).is_relative_to(Path.cwd()), _core.__file__
sys.exit(pytest.main(sys.argv[1:]))
"""


def output(*command: str) -> str:
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


def build_core(folder: Path) -> Path:
    """Build the core in `folder` and return it."""
    definitions = {
        "CMAKE_BUILD_TYPE": "RelWithDebInfo",
        "CMAKE_CXX_COMPILER": os.environ.get("CXX", "g++"),
        "GSVR_SANITIZE": "ON",
        "Python_EXECUTABLE": sys.executable,
        "nanobind_DIR": output(sys.executable, "-m", "nanobind", "--cmake_dir"),
    }
    return build(ROOT / "gsvrcodec" / "native", folder, "_core", definitions)


def stage(core: Path, folder: Path) -> None:
    """Put a copy of the package with `core` in it, and the tests, into `folder`."""
    for name in ("gsvrcodec", "tests"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("*.so"))
    shutil.copy(ROOT / "pyproject.toml", folder)
    shutil.copy(core, folder / "gsvrcodec" / "native")
    shutil.copy(_entropy.__file__, folder / "gsvrcodec" / "native")


def main() -> int:
    arguments = sys.argv[1:]
    split = arguments.index("--") if "--" in arguments else len(arguments)
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(arguments[0]).resolve() if split else Path(temporary, "build")
        core = build_core(folder)
        staged = Path(temporary, "staged")
        staged.mkdir()
        stage(core, staged)
        compiler = os.environ.get("CXX", "g++")
        libraries = [output(compiler, f"-print-file-name=lib{n}.so") for n in ("asan", "ubsan")]
        environment = os.environ | {
            "LD_PRELOAD": ":".join(libraries),
            # Python keeps memory to its end; what matters here is who writes where.
            "ASAN_OPTIONS": "detect_leaks=0",
            "UBSAN_OPTIONS": "halt_on_error=1:print_stacktrace=1",
        }
        command = [sys.executable, "-c", _RUN, "-q", "-n0", "-p", "no:cacheprovider", *_TESTS]
        command += arguments[split + 1 :]
        return subprocess.run(command, cwd=staged, env=environment, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
