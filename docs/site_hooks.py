"""Pages of the site lie all over the repository; each keeps its place, so that links hold."""

from __future__ import annotations

import posixpath
import re
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parent.parent

#: The front page is the README.
_HOME = {"README.md": "index.md"}
#: What is shown or downloaded, and no page.
_ASSETS = ("samples/*.html", "samples/results/*", "tests/benchmarks/results/*.json", "LICENSE")
#: A link or a picture of Markdown: its text, and where it goes.
_LINK = re.compile(r"(!?)\[([^\]]*)\]\(([^)\s#]+)(#[^)\s]*)?\)")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages of the navigation and what they show."""
    pages = _pages(config.nav)
    homes = {site: page for page, site in _HOME.items()}
    assets = (path for pattern in _ASSETS for path in ROOT.glob(pattern) if path.suffix != ".md")
    paths = [ROOT / homes.get(page, page) for page in pages] + sorted(assets)
    for path in paths:
        place = path.relative_to(ROOT).as_posix()
        site = _HOME.get(place, place)
        files.append(File.generated(config, site, abs_src_path=str(path)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Link what is on the site, and name what is not; curves answer to the mouse."""
    folder = posixpath.dirname(page.file.src_uri)

    def placed(link: re.Match[str]) -> str:
        picture, text, target, anchor = link.groups(default="")
        if "://" in target:
            return link[0]
        place = posixpath.normpath(posixpath.join(folder, target))
        site = _HOME.get(place, place)
        if picture and target.endswith(".svg"):
            return f'<object type="image/svg+xml" data="{target}" role="img">{text}</object>'
        if files.get_file_from_path(site) is None:
            if not (ROOT / place).exists():
                raise FileNotFoundError(f"{page.file.src_uri} links {target}, which is not there")
            return text
        return f"{picture}[{text}]({posixpath.relpath(site, folder or '.')}{anchor})"

    return _LINK.sub(placed, markdown)


def _pages(nav: object) -> list[str]:
    """Return the pages of a navigation."""
    match nav:
        case str():
            return [nav]
        case list():
            return [page for part in nav for page in _pages(part)]
        case dict():
            return [page for part in nav.values() for page in _pages(part)]
    return []
