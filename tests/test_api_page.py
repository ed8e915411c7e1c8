"""The page of the Python package is that of its docstrings, and leaves nothing out."""

from __future__ import annotations

import inspect
import re
from typing import Any

import pytest

import gsvrcodec
from tests import api_page


def test_is_up_to_date() -> None:
    assert api_page.PAGE.read_text("utf-8") == api_page.page(), "run python -m tests.api_page"


def test_has_every_public_name() -> None:
    headings = re.findall(r"^### `gsvrcodec\.(\w+)`$", api_page.page(), re.MULTILINE)
    assert set(headings) == set(gsvrcodec.__all__) - {"__version__", "errors"}


@pytest.mark.parametrize(
    "function", [gsvrcodec.encode, gsvrcodec.open, gsvrcodec.decode, gsvrcodec.ClipDataset.__init__]
)
def test_every_argument_is_explained(function: Any) -> None:
    arguments = set(inspect.signature(function).parameters) - {"self"}
    explained = re.findall(r"^ {4}\*{0,2}(\w+): ", inspect.getdoc(function) or "", re.MULTILINE)
    assert arguments == {name for name in explained if not name.endswith("Error")}
