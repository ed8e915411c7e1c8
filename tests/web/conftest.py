"""A browser, the player's server, and pages in which nothing may go wrong unseen."""

from __future__ import annotations

import os
import shutil
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import quote, urlsplit

import pytest

from gsvrcodec.play.collection import open_collection
from gsvrcodec.play.serve import open_server
from tests.vectors import make

#: The browser that renders on the CPU, and asks nothing of the network.
ARGUMENTS = [
    *("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
    *("--no-first-run", "--disable-quic", "--autoplay-policy=no-user-gesture-required"),
    # Pictures follow each other as fast as they are drawn.
    *("--disable-frame-rate-limit", "--disable-gpu-vsync"),
]
NAMES = ("chromium", "chromium-browser", "google-chrome")


def find_browser() -> str | None:
    """Return the path of Chromium: GSVR_TEST_BROWSER, or the installed browser."""
    return os.environ.get("GSVR_TEST_BROWSER") or next(filter(None, map(shutil.which, NAMES)), None)


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """Chromium without a window; tests that need it are skipped where it is not installed."""
    path = find_browser()
    if path is None:
        pytest.skip(f"no browser: none of {', '.join(NAMES)} is installed")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=ARGUMENTS)
        yield browser
        browser.close()


@dataclass
class Site:
    """The player's server over a directory of films."""

    url: str
    films: Path

    def player(self, name: str) -> str:
        """The address of the player with a film of the directory."""
        return f"{self.url}player.html?film=films/{quote(quote(name))}"


@pytest.fixture(scope="session")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    """The conformance streams, served; tests may add films of their own."""
    films = tmp_path_factory.mktemp("films")
    for path in make.VALID.glob("*.gsvr"):
        shutil.copy(path, films)
    server = open_server(open_collection(films), port=0)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield Site(server.url, films)
    server.shutdown()
    server.server_close()


@dataclass
class Watch:
    """Faults of a page, in the order in which they were found."""

    faults: list[str] = field(default_factory=list)

    def follow(self, page: Any) -> None:
        """Note exceptions, messages of the console, and requests that leave this machine."""
        page.on("pageerror", lambda error: self.faults.append(f"exception: {error}"))
        page.on("console", self._note_message)
        page.on("request", self._note_request)

    def _note_message(self, message: Any) -> None:
        # The driver of the graphics device remarks on its speed.
        if message.type in ("error", "warning") and "GL Driver Message" not in message.text:
            self.faults.append(f"{message.type}: {message.text}")

    def _note_request(self, request: Any) -> None:
        address = urlsplit(request.url)
        if address.scheme not in ("data", "blob", "file") and address.hostname != "127.0.0.1":
            self.faults.append(f"request: {request.url}")


@pytest.fixture(scope="module")
def bench(browser: Any, site: Site) -> Iterator[Any]:
    """A page with the modules of the player for the tests of a file, and no film."""
    for page in watched(browser):
        page.add_init_script(path=Path(__file__).parent / "harness.js")
        page.goto(f"{site.url}player.html")
        yield page


@pytest.fixture
def page(browser: Any) -> Iterator[Any]:
    """A page of 960x640; the test fails if anything in it went wrong."""
    yield from watched(browser, viewport={"width": 960, "height": 640})


def watched(browser: Any, **options: Any) -> Iterator[Any]:
    """Yield a page with options of playwright; fail afterwards if anything in it went wrong."""
    page = browser.new_page(**options)
    page.set_default_timeout(20_000)
    watch = Watch()
    watch.follow(page)
    yield page
    page.close()
    assert watch.faults == []
