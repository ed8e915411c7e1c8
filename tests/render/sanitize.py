"""Tests of the renderer on a core built with AddressSanitizer and UndefinedBehaviorSanitizer.

`python -m tests.render.sanitize [BUILD_FOLDER] [-- PYTEST OPTIONS]` builds it (about a minute; with
a folder that is kept, only what has changed), puts it into a copy of the package and runs the tests
there. Needs g++, cmake, ninja and nanobind; the sanitizers' libraries are preloaded, since Python
itself is built without them.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from gsvrcodec.native import _entropy
from tests.cmake_build import ROOT, build
from tests.staged import RUN_PYTEST, stage

#: Tests of the core alone: no interpreted kernels, which are slow, and no processes of their own.
_TESTS = [
    *(f"tests/render/test_{name}.py" for name in ("agreement", "robustness", "adam", "order")),
    *(f"tests/model/test_{name}.py" for name in ("prediction", "quantise")),
]


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


def main() -> int:
    arguments = sys.argv[1:]
    split = arguments.index("--") if "--" in arguments else len(arguments)
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(arguments[0]).resolve() if split else Path(temporary, "build")
        core = build_core(folder)
        staged = Path(temporary, "staged")
        stage({"_core": core, "_entropy": Path(_entropy.__file__)}, staged)
        compiler = os.environ.get("CXX", "g++")
        libraries = [output(compiler, f"-print-file-name=lib{n}.so") for n in ("asan", "ubsan")]
        environment = os.environ | {
            "LD_PRELOAD": ":".join(libraries),
            # Python keeps memory to its end; what matters here is who writes where.
            "ASAN_OPTIONS": "detect_leaks=0",
            "UBSAN_OPTIONS": "halt_on_error=1:print_stacktrace=1",
        }
        command = [sys.executable, "-c", RUN_PYTEST, *_TESTS, *arguments[split + 1 :]]
        return subprocess.run(command, cwd=staged, env=environment, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
