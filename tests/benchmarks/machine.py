"""What a benchmark ran on."""

from __future__ import annotations

import platform
import subprocess
import sys
from pathlib import Path

from gsvrcodec import __version__
from gsvrcodec.native import _core
from gsvrcodec.report.machine import cores, processor


def machine() -> str:
    """Processor, cores in use, kernels, versions and commit, in one line."""
    return (
        f"{processor()}, {cores()} cores, kernels {_core.isa()}, "
        f"gsvrcodec {__version__} ({commit()}), Python {platform.python_version()}"
    )


def commit() -> str:
    """The commit of the working tree, with + when it has changes; "unknown" outside of git."""
    try:
        described = subprocess.run(
            ["git", "describe", "--always", "--dirty=+"],
            cwd=Path(__file__).parent,
            capture_output=True,
            text=True,
            check=True,
        )
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return described.stdout.strip()


def command(module: str) -> str:
    """How this process was started; where files lie on this machine is left out."""
    words = [Path(word).name if Path(word).is_absolute() else word for word in sys.argv[1:]]
    return " ".join(["python -m", module, *words])
