"""Pieces of a page in Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any


def table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[str]:
    """Yield the lines of a table."""
    yield "| " + " | ".join(heads) + " |"
    yield "|---" * len(heads) + "|"
    for row in rows:
        yield "| " + " | ".join(row) + " |"
    yield ""


def number(value: float | None, digits: int) -> str:
    """Return a figure, or a dash for one that there is not."""
    return "-" if value is None else f"{value:.{digits}f}"


def origin_of(name: str, result: dict[str, Any]) -> str:
    """Say which command on what machine a result comes from, and where it is."""
    command = result.get("command", "python -m tests.benchmarks.bunny")
    load = f", load {result['load']:.1f}" if "load" in result else ""
    link = f"[{name}.json](../../tests/benchmarks/results/{name}.json)"
    # Results of ours without a version are older than pictures that are weighted means.
    version = f", bitstream {result['bitstream']}" if "bitstream" in result else ", **sums**"
    version *= "curves" not in result  # of others alone
    return f"`{command}` on {result['machine']}{load}{version}; {link}."


def settings_text(row: dict[str, Any]) -> str:
    """Return what tells a row from the others."""
    return ", ".join(f"{key} {value}" for key, value in row["settings"].items())
