"""Items made ahead by a thread."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import closing

import pytest

from gsvrcodec.ahead import ahead


def numbers(made: list[int], count: int) -> Iterator[int]:
    for number in range(count):
        made.append(number)
        yield number


def test_order_is_kept_and_few_are_made() -> None:
    made: list[int] = []
    with closing(ahead(numbers(made, 100), 7, "made")) as items:
        assert [next(items) for _ in range(40)] == list(range(40))
    assert made == list(range(len(made)))
    assert len(made) <= 40 + 8


@pytest.mark.parametrize("count", [1, 2, 50])
@pytest.mark.parametrize("length", [0, 1, 9])
def test_all_of_them(count: int, length: int) -> None:
    items = ahead(iter([None] * length), count, "made")
    assert list(items) == [None] * length


def test_one_thread_makes_them_and_ends() -> None:
    before = threading.active_count()
    with closing(ahead(iter(threading.current_thread, None), 3, "maker")) as items:
        threads = {next(items) for _ in range(5)}
        assert [thread.name for thread in threads] == ["maker_0"]
    assert threading.active_count() == before


def test_an_error_comes_in_its_turn() -> None:
    def failing() -> Iterator[int]:
        yield 1
        raise OSError("of the second")

    items = ahead(failing(), 5, "made")
    assert next(items) == 1
    with pytest.raises(OSError, match="of the second"):
        next(items)
