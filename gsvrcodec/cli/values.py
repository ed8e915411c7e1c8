"""Values of options as people write them."""

from __future__ import annotations

from typing import Literal

import click

_FACTORS = {"k": 10**3, "m": 10**6, "g": 10**9}


def count(text: str) -> int:
    """Return the whole number that 250000, 250k, 3M or 1.5M stands for."""
    digits, factor = text, _FACTORS.get(text[-1:].lower())
    try:
        if factor is None:
            return int(digits)
        number = float(digits[:-1]) * factor
        if number == int(number):
            return int(number)
    except (ValueError, OverflowError):
        pass
    raise click.BadParameter(f"{text!r} is not a whole number such as 250000, 250k or 3M")


def crop(text: str) -> tuple[int, int, int | None, int | None]:
    """Return width, height, column and row of W:H or W:H:X:Y; None = centred."""
    parts = text.split(":")
    if all(part.isascii() and part.isdigit() for part in parts):
        if len(parts) == 2:
            return int(parts[0]), int(parts[1]), None, None
        if len(parts) == 4:
            return int(parts[0]), int(parts[1]), int(parts[2]), int(parts[3])
    raise click.BadParameter(f"{text!r} is not W:H or W:H:X:Y in pixels, such as 1280:640")


def gop_length(text: str) -> int | Literal["adaptive"]:
    """Return a number of frames, or "adaptive"."""
    if text == "adaptive":
        return "adaptive"
    if text.isascii() and text.isdigit():
        return int(text)
    raise click.BadParameter(f"{text!r} is neither 'adaptive' nor a number of frames")
