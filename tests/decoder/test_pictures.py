"""Pictures as they are asked for: sizes, and the refusal of what no picture can be."""

from __future__ import annotations

import pytest

from gsvrcodec.decoder.pictures import RequestedSize, picture_size
from gsvrcodec.errors import LimitError, UsageError
from gsvrcodec.limits import Limits

CODED = (241, 135)


@pytest.mark.parametrize(
    ("size", "pixels"),
    [
        (None, (241, 135)),
        ((100, 50), (100, 50)),
        ((480, -1), (480, 269)),
        ((480, -2), (480, 268)),
        ((-1, 270), (482, 270)),
        ((-2, 67), (120, 67)),
        ((3, -2), (3, 2)),
        ((1, -1), (1, 1)),
        (2, (482, 270)),
        (0.5, (120, 68)),
        (1.0, (241, 135)),
    ],
    ids=str,
)
def test_sizes(size: RequestedSize | None, pixels: tuple[int, int]) -> None:
    assert picture_size(size, CODED, Limits()) == pixels


@pytest.mark.parametrize(
    ("size", "message"),
    [
        ((0, 5), "cannot be 0x5 pixels"),
        ((5, 0), "cannot be 5x0 pixels"),
        ((-1, -1), "both cannot follow"),
        ((100, -3), "-1 or -2, not -3"),
        (0.001, "cannot be 0x0 pixels"),
        (0, "a scale must be a number over 0"),
        (-2.0, "a scale must be a number over 0"),
        (float("nan"), "a scale must be a number over 0"),
        (float("inf"), "a scale must be a number over 0"),
    ],
    ids=str,
)
def test_no_size_fails(size: RequestedSize, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        picture_size(size, CODED, Limits())


@pytest.mark.parametrize(
    ("size", "limit"),
    [
        ((40_000, 10), "GSVR_LIMIT_WIDTH"),
        ((10, -1), "GSVR_LIMIT_HEIGHT"),
        ((30_000, 30_000), "GSVR_LIMIT_PIXELS"),
        (1e9, "GSVR_LIMIT_WIDTH"),
    ],
    ids=str,
)
def test_too_large_fails(size: RequestedSize, limit: str) -> None:
    coded = (1, 10_000) if size == (10, -1) else CODED
    with pytest.raises(LimitError, match=limit):
        picture_size(size, coded, Limits())
