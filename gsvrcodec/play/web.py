"""The pages of the player, which are data of the package: HTML, style sheet, JavaScript modules."""

from __future__ import annotations

from importlib import resources
from importlib.resources.abc import Traversable

#: Directory of the pages and of all that they load.
WEB: Traversable = resources.files("gsvrcodec").joinpath("web")

#: Media type of each kind of file in it.
MEDIA_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
}
