"""Which films a path holds."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

from gsvrcodec.errors import InputError, NotAVideoError, NotGsvrError
from gsvrcodec.play.collection import Film, open_collection
from tests.play.tools import FILM


def test_a_file_is_one_film(tmp_path: Path) -> None:
    path = Path(shutil.copy(FILM, tmp_path / "a.gsvr"))
    collection = open_collection(path)
    assert collection.films() == [Film("a.gsvr", FILM.stat().st_size)]
    with collection.open("a.gsvr") as film:
        assert film.read() == FILM.read_bytes()
    with pytest.raises(FileNotFoundError):
        collection.open("b.gsvr")


def test_a_directory_may_be_reached_by_a_link(tmp_path: Path) -> None:
    (tmp_path / "films").mkdir()
    shutil.copy(FILM, tmp_path / "films" / "a.gsvr")
    (tmp_path / "link").symlink_to("films")
    assert [film.name for film in open_collection(tmp_path / "link").films()] == ["a.gsvr"]


@pytest.mark.parametrize("content", [b"", b"\x89GSV", b"text\n" * 9, b"\x09GSV\r\n\x1a\n"])
def test_another_file_fails(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.gsvr").write_bytes(content)
    with pytest.raises(NotGsvrError, match=r"not a \.gsvr file"):
        open_collection(tmp_path / "a.gsvr")


def test_an_empty_directory_fails(tmp_path: Path) -> None:
    with pytest.raises(NotAVideoError, match=r"holds no \.gsvr file"):
        open_collection(tmp_path)


def test_what_does_not_exist_fails(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="none does not exist"):
        open_collection(tmp_path / "none")


def test_what_can_be_read_only_once_fails(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in ("-", tmp_path / "pipe", os.devnull, "https://host/film.gsvr"):
        with pytest.raises(InputError, match="is no file or directory"):
            open_collection(path)
