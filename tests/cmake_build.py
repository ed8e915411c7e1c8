"""Native code that only the tests and benchmarks need, built with CMake and Ninja."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

ROOT = Path(__file__).parent.parent


def build(source: Path, folder: Path, target: str, definitions: Mapping[str, str]) -> Path:
    """Build one target of a CMake project and return the library.

    Args:
        source: folder of CMakeLists.txt.
        folder: folder of the build; of an earlier build there, only what changed is built again.
        target: name of the library, without "lib" and endings.
        definitions: CMake's variables by name.
    """
    options = [f"-D{name}={value}" for name, value in definitions.items()]
    configure = ["cmake", "-S", str(source), "-B", str(folder), "-G", "Ninja", *options]
    compile_ = ["cmake", "--build", str(folder), "--target", target]
    for command in (configure, compile_):
        # The standard output is for results.
        subprocess.run(command, check=True, stdout=sys.stderr)
    (library,) = folder.glob(f"*{target}*.so")
    return library
