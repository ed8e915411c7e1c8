"""A page that holds a film and its player."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
from base64 import b64decode, b64encode
from html.parser import HTMLParser
from pathlib import Path

import pytest

from gsvrcodec.errors import InputError, NotGsvrError, OutputError
from gsvrcodec.play import export
from gsvrcodec.play.bundle import bundle
from gsvrcodec.play.export import export_page
from gsvrcodec.play.web import WEB
from tests.play.tools import FILM, PAGES, write_pages


@pytest.fixture
def web(tmp_path: Path) -> Path:
    return write_pages(tmp_path / "web")


@pytest.fixture
def target(tmp_path: Path) -> Path:
    return tmp_path / "film.html"


class Page(HTMLParser):
    """The styles and scripts of a page, and its policy."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None], str]] = []
        self.policy = ""
        self.feed(path.read_text("utf-8"))
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag in ("script", "style"):
            self.elements.append((tag, dict(attrs), ""))
        elif tag == "meta" and "http-equiv" in dict(attrs):
            assert not self.elements
            self.policy = dict(attrs)["content"] or ""

    def handle_data(self, data: str) -> None:
        if self.elements and self.lasttag == self.elements[-1][0]:
            tag, attributes, text = self.elements[-1]
            self.elements[-1] = tag, attributes, text + data

    def handle_endtag(self, tag: str) -> None:
        self.lasttag = ""

    def text(self, tag: str, **wanted: str) -> str:
        """The text of the one element with these attributes."""
        (text,) = (
            text
            for name, attributes, text in self.elements
            if name == tag and wanted.items() <= attributes.items()
        )
        return text


class TestPage:
    def test_has_all_inside(self, web: Path, target: Path) -> None:
        export_page(FILM, target, web=web)
        page = Page(target)
        assert [tag for tag, *_ in page.elements] == ["style", "script", "script", "script"]
        assert page.text("style") == PAGES["style.css"]
        assert page.text("script", id="worker", type="text/plain") == bundle("worker.js", web)
        assert page.elements[-1][1:] == ({"type": "module"}, bundle("player.js", web))
        assert not re.search(r'(?:src|href)="', target.read_text("utf-8"))

    @pytest.mark.parametrize("piece", [3, 300, 3 * 2**18])
    def test_gives_the_film_back(
        self, web: Path, target: Path, piece: int, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(export, "_PIECE_BYTES", piece)
        export_page(FILM, target, web=web)
        text = Page(target).text("script", id="film", type="text/plain")
        assert b64decode(text, validate=True) == FILM.read_bytes()

    def test_is_the_same_every_time(self, web: Path, target: Path, tmp_path: Path) -> None:
        export_page(FILM, target, web=web)
        export_page(str(FILM), str(tmp_path / "again.html"), web=web)
        assert target.read_bytes() == (tmp_path / "again.html").read_bytes()

    def test_allows_what_is_inside_alone(self, web: Path, target: Path) -> None:
        export_page(FILM, target, web=web)
        page = Page(target)
        rules = dict(rule.split(" ", 1) for rule in page.policy.split("; "))

        def hashed(text: str) -> str:
            return f"'sha256-{b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"

        assert rules["default-src"] == rules["base-uri"] == rules["form-action"] == "'none'"
        assert rules["script-src"] == f"{hashed(page.elements[-1][2])} blob:"
        assert rules["style-src"] == hashed(page.text("style"))
        head = target.read_text("utf-8").partition("<head>\n")[2].splitlines()
        assert head[0] == '<meta charset="utf-8">'
        assert head[1].startswith('<meta http-equiv="Content-Security-Policy" ')

    @pytest.mark.parametrize(
        "name", ['a"b>.gsvr', "x'y&amp;.gsvr", "ünï 視頻.gsvr", "a<!-- \\ b.gsvr"]
    )
    def test_has_the_name_of_the_film(
        self, web: Path, target: Path, tmp_path: Path, name: str
    ) -> None:
        export_page(shutil.copy(FILM, tmp_path / name), target, web=web)
        held = [attributes.get("data-name") for _, attributes, _ in Page(target).elements]
        assert held == [None, None, name, None]

    def test_may_have_a_name_that_is_no_text(self, web: Path, target: Path, tmp_path: Path) -> None:
        film = tmp_path / os.fsdecode(b"\xe9.gsvr")
        export_page(shutil.copy(FILM, film), target, web=web)
        assert 'data-name="\ufffd.gsvr"' in target.read_text("utf-8")

    def test_a_style_does_not_end_its_element(self, web: Path, target: Path) -> None:
        (web / "style.css").write_text('a::after { content: "</style>"; }')
        export_page(FILM, target, web=web)
        assert Page(target).text("style") == 'a::after { content: "<\\/style>"; }'


class TestMarks:
    @pytest.mark.parametrize(
        "mark",
        [
            '<meta charset="utf-8">',
            '<link rel="stylesheet" href="style.css">',
            '<script type="module" src="player.js"></script>',
        ],
    )
    def test_missing_or_twice_fails(self, web: Path, target: Path, mark: str) -> None:
        page = PAGES["player.html"]
        for changed in (page.replace(mark, ""), page.replace(mark, mark + mark)):
            (web / "player.html").write_text(changed)
            with pytest.raises(ValueError, match=re.escape(mark)):
                export_page(FILM, target, web=web)
        assert not target.exists()

    def test_the_package_has_them(self, target: Path) -> None:
        export_page(FILM, target)
        page = Page(target)
        assert page.elements[-1][2] == bundle("player.js", WEB)
        assert page.text("script", id="worker") == bundle("worker.js", WEB)
        assert b64decode(page.text("script", id="film")) == FILM.read_bytes()

    @pytest.mark.parametrize("name", ["player.html", "gallery.html"])
    def test_the_pages_of_the_package_keep_to_their_policy(self, name: str) -> None:
        text = WEB.joinpath(name).read_text("utf-8")
        assert not re.search(r"<style|\sstyle=|\son[a-z]+=|javascript:", text)
        assert all("src=" in tag for tag in re.findall(r"<script[^>]*>", text))


class TestFailures:
    def test_an_existing_page_is_kept(self, web: Path, target: Path) -> None:
        target.write_text("old")
        with pytest.raises(OutputError, match="exists already"):
            export_page(FILM, target, web=web)
        assert target.read_text() == "old"
        export_page(FILM, target, overwrite=True, web=web)
        assert target.read_text() != "old"

    def test_the_film_is_not_the_page(self, web: Path, tmp_path: Path) -> None:
        film = Path(shutil.copy(FILM, tmp_path / "a.gsvr"))
        (tmp_path / "b.html").hardlink_to(film)
        for page in (film, tmp_path / "b.html"):
            with pytest.raises(OutputError, match="is the input itself"):
                export_page(film, page, overwrite=True, web=web)
        assert film.read_bytes() == FILM.read_bytes()

    def test_what_is_no_film_fails(self, web: Path, target: Path) -> None:
        with pytest.raises(NotGsvrError):
            export_page(web / "notes.txt", target, web=web)
        with pytest.raises(InputError, match="is a directory"):
            export_page(web, target, web=web)
        assert not target.exists()

    def test_a_large_film_is_warned_of(
        self,
        web: Path,
        target: Path,
        monkeypatch: pytest.MonkeyPatch,
        caplog: pytest.LogCaptureFixture,
    ) -> None:
        export_page(FILM, target, web=web)
        assert not caplog.records
        monkeypatch.setattr(export, "_LARGE_BYTES", 100)
        export_page(FILM, target, overwrite=True, web=web)
        assert "not every browser opens a page of that size" in caplog.text
