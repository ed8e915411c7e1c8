"""Versions of the package and of its libraries."""

from __future__ import annotations

import platform
from functools import cache
from hashlib import sha256
from importlib import metadata
from pathlib import Path

from gsvrcodec import __version__
from gsvrcodec.bitstream.header import VERSION_MAJOR, VERSION_MINOR
from gsvrcodec.native import _core
from gsvrcodec.video.versions import ffmpeg_version


def versions() -> dict[str, str]:
    """Return versions by name; does not import torch."""
    return {
        "gsvrcodec": __version__,
        "sources": sources(),
        "bitstream": f"{VERSION_MAJOR}.{VERSION_MINOR}",
        "native core": _core.isa(),
        "Python": platform.python_version(),
        "NumPy": _installed("numpy"),
        "torch": _installed("torch"),
        "Triton": _installed("triton"),
        "PyAV": _installed("av"),
        "FFmpeg": ffmpeg_version(),
    }


@cache
def sources() -> str:
    """Return a digest of the package's Python code, which may change between two versions."""
    package = Path(__file__).parent
    digest = sha256()
    for path in sorted(package.rglob("*.py")):
        digest.update(path.relative_to(package).as_posix().encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


def _installed(distribution: str) -> str:
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return "not installed"
