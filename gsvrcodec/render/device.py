"""Which device renders: the choice of `device`."""

from __future__ import annotations

import os
import re
import shutil
from importlib.util import find_spec
from pathlib import Path

from gsvrcodec.errors import DeviceError, UsageError

#: Present where a driver for GPUs is: NVIDIA's, that of WSL, AMD's.
_DRIVERS = (Path("/dev/nvidiactl"), Path("/dev/dxg"), Path("/dev/kfd"))

_ELSE = "; or choose `device='cpu'`"


def choose_device(device: str) -> str:
    """Return "cpu" or "cuda:N" for what was asked for.

    Args:
        device: "auto" = the first GPU if it is usable, else the CPU; "cpu", "cuda" or "cuda:N".

    Raises:
        DeviceError: a GPU was asked for and is not usable; says what is missing.
        UsageError: it is none of these.
    """
    if device == "cpu":
        return "cpu"
    if device == "auto":
        # Without a driver torch, which takes a while, need not be loaded.
        usable = any(driver.exists() for driver in _DRIVERS) and not _missing()
        return "cuda:0" if usable else "cpu"
    match = re.fullmatch(r"cuda(?::(\d{1,3}))?", device)
    if not match:
        raise UsageError(f"`device` must be auto, cpu, cuda or cuda:N, not {device!r}")
    if missing := _missing():
        raise DeviceError(f"`device={device!r}`: {missing}{_ELSE}")
    return f"cuda:{_checked(int(match[1] or 0))}"


def _missing() -> str:
    """What keeps this machine from rendering on a GPU; empty if nothing does."""
    if missing := [name for name in ("torch", "triton") if find_spec(name) is None]:
        return f"GPUs need PyTorch and Triton; pip install {' '.join(missing)}"
    if "CC" not in os.environ and not any(map(shutil.which, ("gcc", "clang"))):
        return "Triton needs a C compiler when it is first used; install gcc or clang"
    import torch

    if torch.cuda.is_available():
        return ""
    if torch.version.cuda is None and torch.version.hip is None:
        return "this PyTorch was built for the CPU alone; install one for CUDA, see pytorch.org"
    return "no GPU was found; check its driver with nvidia-smi"


def _checked(index: int) -> int:
    import torch

    count = torch.cuda.device_count()
    if index >= count:
        raise DeviceError(f"`device='cuda:{index}'`: the GPUs here are cuda:0 to cuda:{count - 1}")
    return index
