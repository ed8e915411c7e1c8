"""Running the commands, inside this process or as a user does."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from gsvrcodec.cli import dec, enc, info, play, report

MAINS = {
    "gsvrenc": enc.main,
    "gsvrdec": dec.main,
    "gsvrinfo": info.main,
    "gsvrreport": report.main,
    "gsvrplay": play.main,
}
ROOT = Path(__file__).parent.parent.parent


@dataclass(frozen=True)
class Result:
    """What a command printed and returned."""

    code: int
    out: str
    err: str


class Runner:
    """Runs commands by name in this process."""

    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        self._capsys = capsys

    def __call__(self, name: str, *args: str | Path) -> Result:
        self._capsys.readouterr()
        code = MAINS[name]([str(arg) for arg in args])
        output = self._capsys.readouterr()
        return Result(code, output.out, output.err)

    def fails(self, code: int, name: str, *args: str | Path) -> str:
        """Run a command that must fail with one line, after any progress; return that line."""
        result = self(name, *args)
        assert result.code == code, result
        assert result.out == ""
        assert "Traceback" not in result.err
        *progress, line = result.err.splitlines()
        assert not [each for each in progress if "error" in each or "warning" in each]
        assert line.startswith(f"{name}: error: ")
        return line.removeprefix(f"{name}: error: ")


def start(
    name: str,
    *args: str | Path,
    environment: Mapping[str, str] | None = None,
    **options: Any,
) -> subprocess.Popen[bytes]:
    """Start a command as a process of its own, with some more variables in its environment."""
    module = name.removeprefix("gsvr")
    code = f"import sys; from gsvrcodec.cli.{module} import main; sys.exit(main())"
    variables = {**os.environ, "PYTHONPATH": str(ROOT), "TERM": "dumb", **(environment or {})}
    return subprocess.Popen([sys.executable, "-c", code, *map(str, args)], env=variables, **options)
