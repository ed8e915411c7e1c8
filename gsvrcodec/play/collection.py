"""Which films a path holds: one file, or the .gsvr files of a directory."""

from __future__ import annotations

import os
import re
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from gsvrcodec.bitstream.chunk import SIGNATURE, check_signature
from gsvrcodec.bitstream.source import open_source, path_of
from gsvrcodec.errors import InputError, NotAVideoError
from gsvrcodec.files import check_input, is_stream

#: Name of a film in a directory; hidden files are none.
_FILM_NAME = re.compile(r"[^./][^/]*\.gsvr", re.IGNORECASE | re.DOTALL)


@dataclass(frozen=True, slots=True)
class Film:
    """A film at the time it was asked for."""

    name: str  #: name of the file, without its directory
    size_bytes: int  #: size of the file


@dataclass(frozen=True, slots=True)
class Collection:
    """The films of a path, looked up anew whenever they are asked for."""

    path: Path  #: a film, or a directory of films
    directory: bool  #: which of the two

    def films(self) -> list[Film]:
        """The films, sorted by name; hidden files and subdirectories are left out.

        Raises:
            InputError: The directory cannot be read.
        """
        try:
            paths = self.path.iterdir() if self.directory else [self.path]
            names = sorted(path.name for path in paths)
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise InputError(f"{self.path} cannot be read: {reason}") from error
        films = []
        for name in names:
            with suppress(FileNotFoundError):
                films.append(Film(name, self._find(name).stat().st_size))
        return films

    def open(self, name: str) -> BinaryIO:
        """Open a film by its name.

        Raises:
            OSError: There is no such film, or it cannot be read.
        """
        return self._find(name).open("rb")

    def _find(self, name: str) -> Path:
        """The file of a film; raise `FileNotFoundError` if no film has this name."""
        if self.directory:
            path = self.path / name
            known = _FILM_NAME.fullmatch(name) is not None
        else:
            path, known = self.path, name == self.path.name
        if not (known and path.is_file()):
            raise FileNotFoundError(name)
        return path


def open_collection(path: str | os.PathLike[str]) -> Collection:
    """Return the films of a path.

    Args:
        path: A .gsvr file, or a directory with some.

    Raises:
        InputError: The path does not exist, cannot be read, or can be read only once.
        NotGsvrError: The file does not start with the signature.
        NotAVideoError: The directory holds no .gsvr file.
    """
    if not Path(path).is_dir():
        return Collection(check_film(path), directory=False)
    collection = Collection(Path(path), directory=True)
    if not collection.films():
        raise NotAVideoError(f"{path} holds no .gsvr file")
    return collection


def check_film(path: str | os.PathLike[str]) -> Path:
    """Return `path` if it is a file that starts as a .gsvr file does.

    Raises:
        InputError: The file does not exist, cannot be read, or can be read only once.
        NotGsvrError: The file does not start with the signature.
    """
    if path_of(path) is None or is_stream(path):
        raise InputError(f"{path} is no file or directory; a pipe or a URL cannot be played")
    path = check_input(path)
    with closing(open_source(path)) as source:
        check_signature(source.read_some(0, len(SIGNATURE)))
    return path
