"""A film and its player as one page that needs no server."""

from __future__ import annotations

import hashlib
import logging
import os
from base64 import b64encode
from contextlib import closing
from html import escape
from importlib.resources.abc import Traversable
from pathlib import Path

from gsvrcodec.bitstream.source import Source, open_source
from gsvrcodec.files import check_output, gathered_output
from gsvrcodec.play.bundle import bundle
from gsvrcodec.play.collection import check_film
from gsvrcodec.play.web import WEB

#: Marks in player.html. Content takes the place of the last two in an exported page.
_CHARSET = '<meta charset="utf-8">'
_STYLE = '<link rel="stylesheet" href="style.css">'
_SCRIPT = '<script type="module" src="player.js"></script>'

#: Bytes of a film beyond which browsers may not open its page.
_LARGE_BYTES = 200_000_000
#: Bytes that are encoded at once; a multiple of 3, so that the pieces of base64 join.
_PIECE_BYTES = 3 * 2**18

_log = logging.getLogger(__name__)


def export_page(
    film: str | os.PathLike[str],
    target: str | os.PathLike[str],
    *,
    overwrite: bool = False,
    web: Traversable = WEB,
) -> None:
    """Write a page that plays a film from inside itself.

    Args:
        film: A .gsvr file.
        target: The page, .html; "-" = the standard output.
        overwrite: Whether to replace an existing file.
        web: Directory of the pages of the player.

    Raises:
        InputError: The film does not exist, cannot be read, or shrank while it was read.
        NotGsvrError: The film does not start with the signature.
        OutputError: The page exists, is the film, or cannot be written.
        ValueError: The pages of the player cannot be put together.
    """
    film = check_film(film)
    check_output(target, overwrite=overwrite, source=film)
    before, after = _around(film, web)
    with (
        closing(open_source(film)) as source,
        gathered_output(target, overwrite=overwrite) as partial,
        partial.open("wb") as page,
    ):
        if source.size > _LARGE_BYTES:
            size = f"{source.size / 1e6:.0f} MB"
            _log.warning("%s has %s; not every browser opens a page of that size", film, size)
        page.write(before.encode("utf-8"))
        for offset in range(0, source.size, _PIECE_BYTES):
            page.write(b64encode(_piece(source, offset)))
        page.write(after.encode("utf-8"))


def _piece(source: Source, offset: int) -> bytes:
    return source.read(offset, min(_PIECE_BYTES, source.size - offset))


def _around(film: Path, web: Traversable) -> tuple[str, str]:
    """Return the text of the page before the film, which is base64, and the text after it."""
    style = web.joinpath("style.css").read_text("utf-8").replace("</", r"<\/")
    script = bundle("player.js", web)
    worker = bundle("worker.js", web)
    name = os.fsencode(film.name).decode("utf-8", "replace")
    head, tail = _split(web.joinpath("player.html").read_text("utf-8"), _SCRIPT)
    start, head = _split(head, _CHARSET)
    middle, head = _split(head, _STYLE)
    before = (
        f"{start}{_CHARSET}\n{_policy(script, style)}{middle}<style>{style}</style>{head}"
        f'<script type="text/plain" id="worker">{worker}</script>\n'
        f'<script type="text/plain" id="film" data-name="{escape(name)}">'
    )
    return before, f'</script>\n<script type="module">{script}</script>{tail}'


def _split(page: str, mark: str) -> tuple[str, str]:
    """Return the text before and after a mark; raise `ValueError` if the mark is not there once."""
    before, *after = page.split(mark)
    if len(after) != 1:
        raise ValueError(f"player.html needs, once and in its place: {mark}")
    return before, after[0]


def _policy(script: str, style: str) -> str:
    """Return the element that allows the page to run and load its own content alone."""
    rules = {
        "default-src": "'none'",
        "script-src": f"{_hash(script)} blob:",
        "style-src": _hash(style),
        "worker-src": "blob:",
        "media-src": "blob:",
        "img-src": "data: blob:",
        "connect-src": "blob:",
        "base-uri": "'none'",
        "form-action": "'none'",
    }
    policy = "; ".join(f"{kind} {allowed}" for kind, allowed in rules.items())
    return f'<meta http-equiv="Content-Security-Policy" content="{policy}">'


def _hash(content: str) -> str:
    """An element of a policy that names a script or a style by its content."""
    digest = hashlib.sha256(content.encode("utf-8")).digest()
    return f"'sha256-{b64encode(digest).decode('ascii')}'"
