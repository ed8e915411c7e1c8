"""The site that `.ci/site` builds: its links, and what a browser makes of it."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from functools import partial
from html.parser import HTMLParser
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

import pytest

from tests.web.conftest import watched
from tests.web.driving import until

SITE = Path(__file__).parents[2] / "build" / "site"

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not SITE.exists(), reason="the site is not built: .ci/site"),
]

#: A desktop and a phone: width, height, pixels, and which colours it prefers.
SCREENS = {"desktop": (1280, 900, "light"), "phone": (390, 844, "dark")}


class Found(HTMLParser):
    """Links, anchors, and what the page loads."""

    def __init__(self, page: Path) -> None:
        super().__init__()
        self.links: set[str] = set()
        self.loads: set[str] = set()
        self.anchors: set[str] = set()
        self.feed(page.read_text("utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = {name: value or "" for name, value in attrs}
        self.anchors |= {found[name] for name in ("id", "name") if name in found}
        if tag == "a" and "href" in found:
            self.links.add(found["href"])
        elif tag == "link" and found.get("rel") in ("stylesheet", "icon", "preload"):
            self.loads.add(found["href"])
        elif tag in ("img", "script", "iframe", "source", "video") and "src" in found:
            self.loads.add(found["src"])
        elif tag == "object":
            self.loads.add(found["data"])


@pytest.fixture(scope="module")
def pages() -> dict[Path, Found]:
    ours = (page for page in SITE.rglob("*.html") if page.name not in ("404.html", "player.html"))
    return {page: Found(page) for page in [*ours, SITE / "docs" / "player.html"]}


def test_every_page_is_there(pages: dict[Path, Found]) -> None:
    assert {page.relative_to(SITE).as_posix() for page in pages} >= {
        *("index.html", "CHANGELOG.html", "docs/install.html", "docs/python.html"),
        *("spec/gsvr.html", "spec/cli.html", "spec/api.html", "samples/results/index.html"),
    }


def test_links_lead_somewhere(pages: dict[Path, Found]) -> None:
    broken = []
    for page, found in pages.items():
        for link in found.links | found.loads:
            parts = urlsplit(link)
            if parts.scheme:
                continue
            place = (page.parent / unquote(parts.path)).resolve() if parts.path else page
            place = place / "index.html" if place.is_dir() else place
            known = pages[place].anchors if place in pages else None
            if not place.exists() or (parts.fragment and known and parts.fragment not in known):
                broken.append(f"{page.relative_to(SITE)}: {link}")
    assert broken == []


def test_nothing_is_loaded_from_elsewhere(pages: dict[Path, Found]) -> None:
    assert [load for found in pages.values() for load in found.loads if "//" in load] == []


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    class Quiet(SimpleHTTPRequestHandler):
        def log_message(self, *_: object) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(SITE)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()
    server.server_close()


@pytest.mark.parametrize("screen", SCREENS)
@pytest.mark.parametrize("name", ["index", "docs/benchmarks", "spec/gsvr", "docs/player"])
def test_in_a_browser(browser: Any, address: str, name: str, screen: str) -> None:
    """No page is wider than the window, and none asks for anything elsewhere."""
    width, height, scheme = SCREENS[screen]
    options = {"viewport": {"width": width, "height": height}, "color_scheme": scheme}
    for page in watched(browser, **options):
        page.goto(f"{address}/{name}.html")
        assert page.locator("h1").count() == 1
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        if name == "docs/player":
            picture = page.frame_locator("iframe").locator("#picture")
            picture.scroll_into_view_if_needed()
            until(lambda: picture.get_attribute("data-moment"))  # noqa: B023


def is_ready(page: Any) -> bool:
    """Return whether the search has its index; what is typed before is lost."""
    return "Type to start" in page.locator(".md-search-result__meta").text_content()


def test_search_finds_a_word(browser: Any, address: str) -> None:
    for page in watched(browser):
        page.goto(f"{address}/index.html")
        until(partial(is_ready, page))
        page.get_by_role("textbox", name="Search").press_sequentially("tri-plane")
        until(page.locator(".md-search-result__item").count)
