"""What all commands have in common as click sees them: --help, and help for a wrong call."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import click

from gsvrcodec.cli.habits import habit


class Command(click.Command):
    """A command that says how it is used, and lists its options under headings."""

    def __init__(
        self, *args: Any, groups: Mapping[str, Sequence[str]] | None = None, **kwargs: Any
    ) -> None:
        """Set `groups`: headings in order, with the names of the parameters below each.

        Options without a group come under the last heading; None = all under one.
        """
        kwargs.setdefault("context_settings", {})["help_option_names"] = ["-h", "--help"]
        super().__init__(*args, **kwargs)
        self._groups = groups or {"Options": ()}

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse the arguments; say what to do if there are too few, or those of another program."""
        usage = self.get_usage(ctx).removeprefix("Usage: ").replace("[OPTIONS] ", "")
        if not args and not ctx.resilient_parsing:
            raise click.UsageError(f"usage: {usage}; {self.name} --help lists examples and options")
        hint = habit(str(self.name), args, self.params)
        if hint is not None and not ctx.resilient_parsing:
            raise click.UsageError(hint.format(usage=usage))
        try:
            return super().parse_args(ctx, args)
        except click.MissingParameter as error:
            missing = error.param.make_metavar(ctx) if error.param is not None else "an argument"
            raise click.UsageError(f"{missing} is missing: {usage}") from error
        except click.UsageError as error:
            if not error.message.startswith("Got unexpected extra argument"):
                raise
            message = f"{error.message}: {usage}; a name with spaces takes quotes"
            raise click.UsageError(message) from error

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
