"""Chains of GOPs side by side: processes of this machine, any executor, a Dask cluster."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from typing import Protocol

from gsvrcodec.encoder.chain import ChainTask
from gsvrcodec.encoder.results import EncodedGop


class Runner(Protocol):
    """Does the tasks of an encode, several at a time."""

    @property
    def sends(self) -> bool:
        """Whether tasks leave this machine, so that their frames are to be packed."""

    def at_once(self) -> int:
        """Return how many tasks are done at the same time now."""

    def run(self, tasks: Iterator[ChainTask]) -> Generator[EncodedGop, None, None]:
        """Do all tasks, and yield each GOP as soon as it is done; closing it stops the work."""
