"""How much memory a block takes, whoever allocates it: Python, NumPy or a native library."""

from __future__ import annotations

import ctypes
import gc
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

_STATUS, _RESET = Path("/proc/self/status"), Path("/proc/self/clear_refs")


def _kilobytes(field: str) -> int:
    found = re.search(rf"^{field}:\s*(\d+) kB", _STATUS.read_text(), re.MULTILINE)
    assert found is not None
    return int(found[1])


@contextmanager
def at_most(size: int) -> Iterator[None]:
    """Fail where the block makes this process hold so many bytes more than before.

    Counts resident pages, which only Linux can; elsewhere it checks nothing.
    """
    gc.collect()
    with suppress(OSError, AttributeError):  # memory that is free but kept would hide what is new
        ctypes.CDLL(None).malloc_trim(0)
    try:
        _RESET.write_text("5")
        before = _kilobytes("VmRSS")
    except OSError:
        yield
        return
    yield
    taken = 1024 * (_kilobytes("VmHWM") - before)
    if taken > size:
        pytest.fail(f"{taken / 2**20:.0f} MiB were taken, over {size / 2**20:.0f}")
