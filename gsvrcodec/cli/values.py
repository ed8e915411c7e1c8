"""Parsers of option values."""

from __future__ import annotations

import re
from fractions import Fraction
from typing import TYPE_CHECKING, Literal

import click

from gsvrcodec.errors import UsageError

if TYPE_CHECKING:
    from gsvrcodec.report.reference import Reference

_TIME = re.compile(r"(?:(?:(\d+):)?(\d+):)?(\d{1,12}(?:\.\d{1,12})?)", re.ASCII)
_RATE = re.compile(r"\d{1,12}(?:\.\d{1,12}|/\d{1,12})?", re.ASCII)
_SIZE = re.compile(r"(-[12]|\d{1,9})[x:](-[12]|\d{1,9})", re.ASCII)
_FILE_SIZE = re.compile(r"(\d{1,15}(?:\.\d{1,6})?)([kmg]?)(?:(i)?b)?", re.ASCII | re.IGNORECASE)

_FACTORS = {"k": 10**3, "m": 10**6, "g": 10**9}


def count(text: str) -> int:
    """Parse a whole number such as 250000, 250k, 3M or 1.5M."""
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


def file_size(text: str) -> int:
    """Parse a size such as 700000, 700k, 1.5MB, 10M or 1.5MiB; return bytes."""
    match = _FILE_SIZE.fullmatch(text)
    if match is None:
        raise click.BadParameter(f"{text!r} is not a size such as 700k, 10MB or 1.5MiB")
    number, unit, binary = match.groups(default="")
    scale: int = (1024 if binary else 1000) ** " kmg".index(unit.lower() or " ")
    return round(Fraction(number) * scale)


def crop(text: str) -> tuple[int, int, int | None, int | None]:
    """Parse a crop, W:H or W:H:X:Y; return width, height, column, row, None = centred."""
    parts = text.split(":")
    if all(part.isascii() and part.isdigit() for part in parts):
        if len(parts) == 2:
            return int(parts[0]), int(parts[1]), None, None
        if len(parts) == 4:
            return int(parts[0]), int(parts[1]), int(parts[2]), int(parts[3])
    raise click.BadParameter(f"{text!r} is not W:H or W:H:X:Y in pixels, such as 1280:640")


def gop_length(text: str) -> int | Literal["adaptive"]:
    """Parse a GOP length: a number of frames, or "adaptive"."""
    if text == "adaptive":
        return "adaptive"
    if text.isascii() and text.isdigit():
        return int(text)
    raise click.BadParameter(f"{text!r} is neither 'adaptive' nor a number of frames")


def seconds(text: str) -> Fraction:
    """Parse a time such as 90.5, 1:30.5 or 0:01:30.5; return seconds."""
    match = _TIME.fullmatch(text)
    if match is None:
        raise click.BadParameter(f"{text!r} is not a time such as 90.5, 1:30.5 or 0:01:30.5")
    hours, minutes, rest = match.groups(default="0")
    return 3600 * int(hours) + 60 * int(minutes) + Fraction(rest)


def rate(text: str) -> Fraction:
    """Parse a rate such as 60, 59.94 or 60000/1001."""
    if _RATE.fullmatch(text):
        try:
            return Fraction(text)
        except ZeroDivisionError:
            pass
    raise click.BadParameter(f"{text!r} is not a number such as 60, 0.25 or 60000/1001")


def size(text: str) -> tuple[int, int]:
    """Parse a size, WxH or W:H; a side of -1 or -2 follows from the aspect ratio."""
    match = _SIZE.fullmatch(text)
    if match is None:
        raise click.BadParameter(f"{text!r} is not WxH in pixels, such as 1280x720 or 1280x-2")
    return int(match[1]), int(match[2])


def references(text: str) -> list[Reference]:
    """Return the encoders that x264 or x264:key=12,svtav1 stands for."""
    from gsvrcodec.report.reference import parse_reference

    try:
        return [parse_reference(name) for name in text.split(",")] if text else []
    except UsageError as error:
        raise click.BadParameter(str(error)) from error
