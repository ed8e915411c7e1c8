"""gsvrplay: play .gsvr files in a browser."""

from __future__ import annotations

import signal
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from threading import Thread
from types import FrameType
from typing import TYPE_CHECKING

import click

from gsvrcodec.cli.command import Command
from gsvrcodec.cli.common import about, may_overwrite, overwrite_option, run, version_option

if TYPE_CHECKING:
    from gsvrcodec.play.collection import Collection


def main(args: Sequence[str] | None = None) -> int:
    """Run gsvrplay and return its exit code."""
    return run(command, args)


@click.command("gsvrplay", cls=Command, context_settings={"max_content_width": 100})
@click.argument("source", metavar="INPUT")
@click.option(
    "--export",
    "page",
    metavar="FILE.html",
    help="Write one page that holds player and film and needs no server, instead of serving; "
    "- = standard output.",
)
@overwrite_option
@click.option(
    "--host",
    default="127.0.0.1",
    show_default=True,
    metavar="ADDRESS",
    help="Address to listen at. At any but the default, such as 0.0.0.0, others on the network "
    "can read the films.",
)
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    metavar="N",
    help="Port to listen at, 0 = any free one; by default 8787, or any free one if that is taken.",
)
@click.option("--no-browser", is_flag=True, help="Do not open the page in the browser.")
@version_option
def command(
    source: str,
    page: str | None,
    overwrite: bool,
    host: str,
    port: int | None,
    no_browser: bool,
) -> None:
    """Play a .gsvr file, or the .gsvr files of a directory, in a browser.

    INPUT is served until Ctrl-C, to browsers on this machine.

    \b
    gsvrplay out.gsvr
    gsvrplay films/
    gsvrplay out.gsvr --export film.html
    gsvrplay --no-browser --host 0.0.0.0 --port 8000 films/
    """
    import webbrowser

    from gsvrcodec.play.collection import open_collection
    from gsvrcodec.play.export import export_page
    from gsvrcodec.play.serve import open_server

    with about(source):
        collection = open_collection(source)
    if page is not None:
        if collection.directory:
            raise click.UsageError("--export is for one film; name a file")
        export_page(collection.path, page, overwrite=may_overwrite(page, overwrite))
        return
    with _until_interrupted(), open_server(collection, host=host, port=port) as server:
        click.echo(f"{server.url} {_what(collection)}; Ctrl-C ends it")
        if not no_browser:
            # In a thread of its own: a browser on the terminal keeps whoever opens it waiting.
            Thread(target=webbrowser.open, args=(server.url,), daemon=True).start()
        server.serve_forever()


def _what(collection: Collection) -> str:
    """Say what the server has."""
    name = click.format_filename(collection.path)
    if not collection.directory:
        return f"plays {name}"
    count = len(collection.films())
    return f"shows {count} film{'s' * (count != 1)} of {name}"


@contextmanager
def _until_interrupted() -> Iterator[None]:
    """End the block at Ctrl-C or SIGTERM: that is how one ends a server, and no failure."""

    def stop(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    usual = signal.signal(signal.SIGTERM, stop)
    try:
        with suppress(KeyboardInterrupt):
            yield
    finally:
        signal.signal(signal.SIGTERM, usual)
