"""Choice of the instruction set and of the number of threads."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from gsvrcodec.native import _core

_PRINT = "from gsvrcodec.native import _core; print(_core.isa(), _core.resolve_threads(0))"


def _run(**environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", _PRINT],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        check=False,
    )


def test_portable_is_always_there() -> None:
    assert _core.isas()[-1] == "portable"


@pytest.mark.parametrize("name", _core.isas())
def test_environment_chooses(name: str) -> None:
    assert _run(GSVR_ISA=name, GSVR_THREADS="3").stdout.split() == [name, "3"]


def test_unknown_isa_fails() -> None:
    result = _run(GSVR_ISA="mmx")
    assert "GSVR_ISA=mmx is not available here: use one of" in result.stderr
    with pytest.raises(RuntimeError, match="mmx is not available"):
        _core.use_isa("mmx")


def test_threads() -> None:
    assert _core.resolve_threads(5) == 5
    assert _core.resolve_threads(10**6) == 256
    assert _core.resolve_threads(-1) >= 1
