"""The pages as they are written: nothing that runs text as code, nothing from elsewhere."""

from __future__ import annotations

import re
import zlib
from pathlib import Path

import pytest

import gsvrcodec
from tests.web import sample_page

WEB = Path(gsvrcodec.__file__).parent / "web"
FILES = sorted(path for path in WEB.iterdir() if path.is_file())
SPEC = (WEB.parent.parent / "spec" / "gsvr.md").read_text("utf-8")


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_nothing_runs_text_or_comes_from_elsewhere(path: Path) -> None:
    text = path.read_text("utf-8")
    found = re.findall(r"\beval\(|\bFunction\(|innerHTML|outerHTML|document\.write|https?://", text)
    assert found == []
    assert " style=" not in text  # which the policy of the pages forbids
    assert not re.search(r'\son\w+="', text)


def test_size() -> None:
    """Bytes of all files, compressed, as the server sends them and the wheel holds them."""
    assert sum(len(zlib.compress(path.read_bytes(), 9)) for path in FILES) < 64_000


def test_sections_of_the_spec_are_found() -> None:
    """Each section that a decoder implements is named where it is implemented."""
    text = "".join(path.read_text("utf-8") for path in FILES)
    named = set(re.findall(r"(?:section|sections|and|,|to) (\d+(?:\.\d)?)\b", text))
    wanted = {"3", "4", "5.1", "5.2", "5.3", "5.4", "5.5", "5.6", "6", "7", "8.1", "8.2", "8.3"}
    assert wanted | {"5.7", "8.4", "8.5", "9", "10", "11", "12"} <= named
    headings = set(re.findall(r"^#+ (\d+(?:\.\d)?)[. ]", SPEC, re.MULTILINE))
    assert headings >= wanted


def test_sample_page_is_up_to_date(tmp_path: Path) -> None:
    """If not: `python -m tests.web.sample_page`."""
    target = tmp_path / "player.html"
    sample_page.write(target)
    assert target.read_bytes() == sample_page.PAGE.read_bytes()


def test_the_film_of_the_sample_page_is_of_this_format() -> None:
    """If not: encode it anew, and `python -m tests.web.sample_page FILM`."""
    name, film = sample_page.film_in(sample_page.PAGE.read_text("utf-8"))
    assert name == "bunny.gsvr"
    with gsvrcodec.open(film) as decoder:
        assert len(decoder) == 24
        assert decoder[-1].data.shape == (180, 320, 3)
