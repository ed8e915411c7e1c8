"""Shared by the commands: errors in one line, exit codes, messages, options."""

from __future__ import annotations

import logging
import os
import re
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

import click

from gsvrcodec.errors import CorruptError, GsvrError, OutputError, UnsupportedError
from gsvrcodec.files import atomic_output

EXIT_FAILURE = 1
EXIT_CORRUPT = 3
EXIT_PARTIAL = 5
EXIT_MISMATCH = 6
EXIT_INTERRUPTED = 130

#: Environment variable that shows the traceback of an unexpected error.
DEBUG = "GSVR_DEBUG"

#: An argument in a message of the library: `name` or `name=value`, and no part of a file's name.
_ARGUMENT = re.compile(r"(?<![^\s(])`([a-z]\w*)(?:='?([^`']*)'?)?`(?![^\s,;:)])")


class _FileError(click.ClickException):
    """An error with the name of the file that caused it."""

    def __init__(self, message: str, exit_code: int) -> None:
        super().__init__(message)
        self.status = exit_code


def run(command: click.Command, args: Sequence[str] | None) -> int:
    """Run a command; print every failure as one line and return the exit code.

    Args:
        command: The command; its return value is the exit code, None = 0.
        args: Arguments of the command; None = those of the process.
    """
    with _warnings_on_stderr(command), _second_interrupt_at_once():
        try:
            code = command.main(args, prog_name=command.name, standalone_mode=False)
            sys.stdout.flush()
            return code or 0
        except GsvrError as error:
            return _failed(command, _with_notes(str(error), error), error.exit_code)
        except _FileError as error:
            return _failed(command, error.message, error.status)
        except click.ClickException as error:
            return _failed(command, error.format_message(), error.exit_code)
        except (click.Abort, KeyboardInterrupt) as error:
            # click turns an interrupt into an Abort, and keeps it as the cause.
            message = _with_notes("interrupted", error.__cause__ or error)
            return _failed(command, message, EXIT_INTERRUPTED)
        except BrokenPipeError:
            return EXIT_FAILURE  # the reader of the pipe has gone: no message
        except MemoryError as error:
            return _failed(command, _with_notes("out of memory", error), EXIT_FAILURE)
        except Exception as error:
            if DEBUG in os.environ:
                raise
            what = f"{type(error).__name__}: {error}".splitlines()[0]
            hint = "" if isinstance(error, OSError) else f" (set {DEBUG}=1 to see where)"
            return _failed(command, _with_notes(f"{what}{hint}", error), EXIT_FAILURE)
        finally:
            _drop_unwritable()


def _drop_unwritable() -> None:
    """Drop what the standard output cannot take: flushed at exit, it would change the exit code."""
    try:
        if sys.stdout is not None:
            sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def as_options(message: str, parameters: Sequence[click.Parameter]) -> str:
    """Return a message of the library with its arguments as the options of a command.

    The library writes arguments as in Python, in backticks: `gop_min=9` becomes --gop-min 9,
    `device='cpu'` --device cpu, `resume=True` --resume and `audio=False` --no-audio. What is not
    an option of the command stays as it is.

    Args:
        message: what the library says.
        parameters: of the command that says it.
    """
    options = {each.name: each for each in parameters if isinstance(each, click.Option)}

    def spelled(argument: re.Match[str]) -> str:
        option, value = options.get(argument[1]), argument[2]
        if option is None:
            return argument[0]
        spellings = option.secondary_opts if value == "False" else option.opts
        if not spellings:
            return argument[0]
        spelling = max(spellings, key=len)
        return spelling if value in (None, "True", "False") else f"{spelling} {value}"

    return _ARGUMENT.sub(spelled, message)


@contextmanager
def about(path: str | os.PathLike[str]) -> Iterator[None]:
    """Add the name of the file to a `CorruptError` or `UnsupportedError` of the block."""
    try:
        yield
    except (CorruptError, UnsupportedError) as error:
        message = _with_notes(f"{os.fspath(path)}: {error}", error)
        raise _FileError(message, error.exit_code) from error


def may_overwrite(path: str | None, overwrite: bool) -> bool:
    """Return `overwrite`; for an existing file on a terminal, ask the user."""
    if overwrite or path in (None, "-") or not Path(str(path)).is_file():
        return overwrite
    if not (sys.stdin.isatty() and sys.stderr.isatty()):
        return False
    if click.confirm(f"{path} exists already. Overwrite it?", err=True):
        return True
    raise OutputError(f"{path} is left as it is")


def counted(number: int, noun: str) -> str:
    """Return a number with its noun: "1 frame", "1,200 frames"."""
    return f"{number:,} {noun}{'s' * (number != 1)}"


def not_on_a_terminal(path: str | None) -> None:
    """Refuse to print a film on a terminal.

    Raises:
        click.UsageError: `path` is the standard output, and that is a terminal.
    """
    if path == "-" and sys.stdout.isatty():
        raise click.UsageError("a film on a terminal is no use: name a file, or pipe the output")


def write_text(path: str, text: str, *, overwrite: bool) -> None:
    """Write text to a file, or to the standard output for "-"."""
    if path == "-":
        click.echo(text, nl=False)
        return
    with atomic_output(path, overwrite=overwrite) as partial:
        partial.write_text(text, encoding="utf-8", newline="\n")


def show_version(ctx: click.Context, _: click.Parameter, wanted: bool) -> None:
    """Print the versions of the package and of its libraries, and exit."""
    if not wanted or ctx.resilient_parsing:
        return
    from gsvrcodec.versions import versions

    for name, version in versions().items():
        click.echo(f"{name:<12}{version}")
    ctx.exit()


version_option = click.option(
    "--version",
    is_flag=True,
    expose_value=False,
    is_eager=True,
    callback=show_version,
    help="Show the versions of the package and of its libraries, and exit.",
)
overwrite_option = click.option(
    "-y", "overwrite", is_flag=True, help="Overwrite an existing output."
)
quiet_option = click.option("-q", "--quiet", is_flag=True, help="Print errors and warnings only.")
threads_option = click.option(
    "--threads",
    type=click.IntRange(min=0),
    default=0,
    metavar="N",
    show_default=True,
    help="CPU threads; 0 = GSVR_THREADS or all cores.",
)
device_option = click.option(
    "--device",
    default="auto",
    metavar="NAME",
    show_default=True,
    help="Device: cpu, cuda, cuda:N, or auto = the first usable GPU, else the CPU.",
)


def _with_notes(message: str, error: BaseException) -> str:
    """Return a message with the notes of an error, such as how to resume."""
    return "; ".join([message, *getattr(error, "__notes__", ())])


@contextmanager
def _second_interrupt_at_once() -> Iterator[None]:
    """Make the first Ctrl-C stop the command cleanly, and the second one at once."""
    usual = signal.default_int_handler
    in_main = threading.current_thread() is threading.main_thread()
    if not in_main or signal.getsignal(signal.SIGINT) is not usual:
        yield
        return

    def first(number: int, frame: FrameType | None) -> None:
        signal.signal(signal.SIGINT, lambda *_: os._exit(EXIT_INTERRUPTED))
        raise KeyboardInterrupt

    signal.signal(signal.SIGINT, first)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, usual)


def _failed(command: click.Command, message: str, code: int) -> int:
    """Print why a command failed and return its exit code."""
    line = as_options(" ".join(message.split()), command.params)
    click.echo(f"{command.name}: error: {line}", err=True)
    return code


@contextmanager
def _warnings_on_stderr(command: click.Command) -> Iterator[None]:
    """Print what the library warns of while the command runs."""
    handler = logging.StreamHandler()
    handler.setFormatter(_WithOptions(command))
    handler.addFilter(_lower_level)
    handler.addFilter(_Once())
    logger = logging.getLogger("gsvrcodec")
    logger.addHandler(handler)
    try:
        yield
    finally:
        logger.removeHandler(handler)


def _lower_level(record: logging.LogRecord) -> bool:
    """Write the level in lower case, as in "warning"."""
    record.levelname = record.levelname.lower()
    return True


class _WithOptions(logging.Formatter):
    """Writes a record as a line of a command, and arguments as its options."""

    def __init__(self, command: click.Command) -> None:
        super().__init__(f"{command.name}: %(levelname)s: %(message)s")
        self._parameters = command.params

    def format(self, record: logging.LogRecord) -> str:
        return as_options(super().format(record), self._parameters)


class _Once(logging.Filter):
    """Pass each message once: the encoder reads its source several times."""

    def __init__(self) -> None:
        super().__init__()
        self._seen: set[str] = set()

    def filter(self, record: logging.LogRecord) -> bool:
        message = record.getMessage()
        new = message not in self._seen
        self._seen.add(message)
        return new
