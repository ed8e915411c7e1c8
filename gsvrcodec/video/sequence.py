"""Numbered pictures as a video."""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path

from gsvrcodec.errors import InputError

#: The number in the name of a picture, in printf notation.
NUMBER = re.compile(r"%0?\d*d")


def first_of_sequence(path: Path) -> int | None:
    """Return the first number of the pictures of a pattern such as in_%04d.png.

    Returns:
        The number, or None if `path` is a file or no pattern.

    Raises:
        InputError: No picture matches, or a number is missing in the sequence.
    """
    if path.exists() or len(NUMBER.findall(path.name)) != 1 or path.name.count("%") != 1:
        return None
    before, after = NUMBER.split(path.name)
    pattern = re.compile(re.escape(before) + r"(\d+)" + re.escape(after))
    names = path.parent.iterdir() if path.parent.is_dir() else ()
    found = sorted(
        int(match[1])
        for match in (pattern.fullmatch(each.name) for each in names)
        if match and match[0] == path.name % int(match[1])
    )
    if not found:
        raise InputError(f"{path} does not exist, nor pictures with a number in its place")
    for last, following in pairwise(found):
        if following != last + 1:
            raise InputError(
                f"{path.with_name(path.name % (last + 1))} is missing, "
                f"but there is {path.name % following}"
            )
    return found[0]
