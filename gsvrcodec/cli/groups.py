"""Output of --help with the options under headings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import click


class GroupedCommand(click.Command):
    """A command that lists its options under headings."""

    def __init__(self, *args: Any, groups: Mapping[str, Sequence[str]], **kwargs: Any) -> None:
        """Set `groups`: headings in order, with the names of the parameters below each.

        Options without a group come under the last heading.
        """
        super().__init__(*args, **kwargs)
        self._groups = groups

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options under their headings, in the order of the command."""
        headings = {name: heading for heading, names in self._groups.items() for name in names}
        last = list(self._groups)[-1]
        rows: dict[str, list[tuple[str, str]]] = {heading: [] for heading in self._groups}
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx)
            if record is not None and isinstance(parameter, click.Option):
                rows[headings.get(parameter.name or "", last)].append(record)
        for heading, records in rows.items():
            with formatter.section(heading):
                formatter.write_dl(records)
