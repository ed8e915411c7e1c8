"""The page in `samples`: `python -m tests.web.sample_page` writes it anew around the film in it.

A path of a .gsvr file as argument puts another film in.
"""

from __future__ import annotations

import base64
import re
import sys
import tempfile
from pathlib import Path

from gsvrcodec.play.export import export_page
from tests.making import SAMPLES

PAGE = SAMPLES / "player.html"


def film_in(page: str) -> tuple[str, bytes]:
    """Return the name and the content of the film in a page."""
    found = re.search(r'id="film" data-name="([\w.-]+)">([\w+/=]*)</script>', page)
    assert found is not None, "the page holds no film"
    return found[1], base64.b64decode(found[2])


def write(target: Path) -> None:
    """Write the page with the player as it is now."""
    name, film = film_in(PAGE.read_text("utf-8"))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        path.write_bytes(film)
        export_page(path, target, overwrite=True)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        export_page(sys.argv[1], PAGE, overwrite=True)
    else:
        write(PAGE)
