"""Versions of the package and of its libraries."""

from __future__ import annotations

import platform
from importlib import metadata

from gsvrcodec import __version__
from gsvrcodec.bitstream.header import VERSION_MAJOR, VERSION_MINOR
from gsvrcodec.native import _core
from gsvrcodec.video.versions import ffmpeg_version


def versions() -> dict[str, str]:
    """Return versions by name; does not import torch."""
    return {
        "gsvrcodec": __version__,
        "bitstream": f"{VERSION_MAJOR}.{VERSION_MINOR}",
        "native core": _core.isa(),
        "Python": platform.python_version(),
        "torch": _installed("torch"),
        "Triton": _installed("triton"),
        "PyAV": _installed("av"),
        "FFmpeg": ffmpeg_version(),
    }


def _installed(distribution: str) -> str:
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return "not installed"
