"""The native core compiled for arm64, its tests, and an encode: `python -m tests.arm64 [FOLDER]`.

QEMU runs them with Debian's Python for arm64 and PyPI's packages for it, which are fetched into
FOLDER (1.3 GB) and stay there for the next time. Needs Debian's g++-aarch64-linux-gnu and
qemu-user, without which it says so and does nothing, and cmake, ninja and nanobind.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pip

from tests.cmake_build import ROOT, build
from tests.render.sanitize import output
from tests.staged import RUN_PYTEST, stage

_NEEDED = {"aarch64-linux-gnu-g++": "g++-aarch64-linux-gnu", "qemu-aarch64": "qemu-user"}
#: apt on its own folder, for the other architecture, without what is installed here.
_APT = """
APT::Architecture "arm64";
APT::Architectures "arm64";
Acquire::Languages "none";
Dir::State "{0}";
Dir::State::status "{0}/status";
Dir::Cache "{0}";
Dir::Etc::sourcelist "{0}/sources.list";
Dir::Etc::sourceparts "/dev/null";
"""
_SOURCE = "deb http://deb.debian.org/debian bookworm main\n"
_DEBIAN = ["python3.11", "libpython3.11-dev", "libstdc++6"]
#: Wheels of torch for arm64 that came later bring CUDA, and there is none of triton that is needed.
_TORCH = "torch==2.8.0"
_PYPI = ["numpy", "av", "imagecodecs", "opencv-contrib-python-headless", "click", "rich"]
_PYPI += ["pytest", "pytest-xdist", "hypothesis"]
#: Tests of the core that start no processes: those would not run under QEMU.
_TESTS = [f"tests/render/test_{n}.py" for n in ("agreement", "robustness", "adam", "backends")]
_TESTS += ["tests/render/test_invariance.py", "tests/render/test_order.py"]
_TESTS += ["tests/planes", "tests/test_vectors.py", "-k", "not triton"]
_ENCODE = """
import sys
sys.path.insert(0, ".")
from gsvrcodec.cli import enc, info
sample = "samples/bunny_24f_320x180_audio.mp4"
enc.command([sample, "a.gsvr", "--preset", "fastest", "--workers", "1"], standalone_mode=False)
info.command(["a.gsvr", "--verify"], standalone_mode=False)
"""


def fetch_system(folder: Path) -> None:
    """Unpack Debian's Python for arm64, with the libraries that it needs, into `folder`."""
    apt = folder.with_name("apt")
    for name in ("lists/partial", "archives/partial"):
        (apt / name).mkdir(parents=True, exist_ok=True)
    (apt / "status").touch()
    (apt / "sources.list").write_text(_SOURCE)
    (apt / "apt.conf").write_text(_APT.format(apt))
    environment = os.environ | {"APT_CONFIG": str(apt / "apt.conf")}
    install = ["install", "-y", "--no-install-recommends", "--download-only", *_DEBIAN]
    for command in (["update"], install):
        subprocess.run(["apt-get", "-q", *command], env=environment, check=True)
    for package in sorted((apt / "archives").glob("*.deb")):
        subprocess.run(["dpkg-deb", "--extract", package, folder], check=True)


def fetch_packages(python: list[str], folder: Path) -> None:
    """Install the packages for arm64 into `folder`, by the pip of this Python under QEMU."""
    pins = (ROOT / "constraints.txt").read_text("utf-8").splitlines(keepends=True)
    constraints = folder.with_name("constraints.txt")
    constraints.write_text("".join(p for p in pins if not p.startswith(("torch==", "triton=="))))
    command = [*python, str(Path(pip.__file__).parent), "install", "-q", "--target", str(folder)]
    command += ["--only-binary", ":all:", "-c", str(constraints), _TORCH, *_PYPI]
    environment = {k: v for k, v in os.environ.items() if not k.endswith("_CONSTRAINT")}
    subprocess.run(command, env=environment, check=True)


def build_modules(system: Path, folder: Path) -> dict[str, Path]:
    """Cross-compile both native modules in `folder`."""
    definitions = {
        "CMAKE_BUILD_TYPE": "Release",
        "CMAKE_SYSTEM_NAME": "Linux",
        "CMAKE_SYSTEM_PROCESSOR": "aarch64",
        "CMAKE_CXX_COMPILER": "aarch64-linux-gnu-g++",
        # Python's headers refer to headers of their architecture.
        "CMAKE_CXX_FLAGS": f"-idirafter {system}/usr/include",
        "Python_EXECUTABLE": sys.executable,
        "Python_INCLUDE_DIR": f"{system}/usr/include/python3.11",
        "nanobind_DIR": output(sys.executable, "-m", "nanobind", "--cmake_dir"),
    }
    source = ROOT / "gsvrcodec" / "native"
    return {name: build(source, folder, name, definitions) for name in ("_core", "_entropy")}


def main() -> int:
    missing = [package for command, package in _NEEDED.items() if not shutil.which(command)]
    if missing:
        print(f"skipped: install {' and '.join(missing)} first")
        return 0
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(sys.argv[1] if len(sys.argv) > 1 else temporary).resolve()
        system, packages = folder / "system", folder / "packages"
        python = ["qemu-aarch64", "-L", str(system), str(system / "usr/bin/python3.11")]
        if not system.exists():
            fetch_system(system)
        if not packages.exists():
            fetch_packages(python, packages)
        staged = Path(temporary, "staged")
        stage(build_modules(system, folder / "build"), staged)
        environment = os.environ | {"PYTHONPATH": str(packages)}
        for code, arguments in ((RUN_PYTEST, _TESTS), (_ENCODE, [])):
            command = [*python, "-c", code, *arguments]
            subprocess.run(command, cwd=staged, env=environment, check=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
