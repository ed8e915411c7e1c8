"""The kernels that the native renderer is compared with, built on demand.

Needs g++, cmake and ninja. The build stays in `build/benchmarks`; later calls build what changed.
"""

from __future__ import annotations

import ctypes
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gsvrcodec.model.gop import Gop
from tests.cmake_build import ROOT, build


class Baseline:
    """A plain rasteriser, and the processor's peak of multiply-adds."""

    def __init__(self) -> None:
        """Build and load the library."""
        folder = ROOT / "build" / "benchmarks"
        library = build(
            Path(__file__).parent, folder, "gsvr_baseline", {"CMAKE_BUILD_TYPE": "Release"}
        )
        loaded = ctypes.CDLL(str(library))
        floats = np.ctypeslib.ndpointer(np.float32, flags="C_CONTIGUOUS")
        samples = np.ctypeslib.ndpointer(np.uint8, ndim=3, flags="C_CONTIGUOUS")
        self._render = loaded.gsvr_plain_render
        self._render.argtypes = [ctypes.c_char_p, *[floats] * 4, *[ctypes.c_int] * 4, samples]
        self._render.restype = None
        self._peak = loaded.gsvr_multiply_adds_per_second
        self._peak.argtypes = [ctypes.c_char_p, ctypes.c_int]
        self._peak.restype = ctypes.c_double

    def render(self, gop: Gop, isa: str, threads: int, out: NDArray[np.uint8]) -> None:
        """Render the canonical Gaussians of a GOP, without deformation, to `out` (H, W, 3)."""
        height, width, _ = out.shape
        arrays = (gop.position, gop.log_scale, gop.rotation, gop.colour)
        self._render(isa.encode(), *arrays, len(gop), width, height, threads, out)

    def multiply_adds_per_second(self, isa: str, threads: int) -> float:
        """Measure multiply-adds on vectors in registers, all threads together."""
        rate: float = self._peak(isa.encode(), threads)
        return rate
