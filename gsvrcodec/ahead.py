"""Items of an iterator, made by a thread before they are asked for."""

from __future__ import annotations

from collections import deque
from collections.abc import Generator, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar, cast

T = TypeVar("T")


def ahead(items: Iterator[T], count: int, name: str) -> Generator[T, None, None]:
    """Yield the items; a thread makes up to `count` of them in advance.

    Closing the generator waits for the item that is being made, if any, and drops the others.

    Args:
        items: made by one thread, one after another; whatever they raise is raised here.
        count: at least 1.
        name: of the thread.
    """
    end = object()
    with ThreadPoolExecutor(1, name) as worker:
        try:
            coming = deque(worker.submit(next, items, end) for _ in range(count))
            while (item := coming.popleft().result()) is not end:
                coming.append(worker.submit(next, items, end))
                yield cast(T, item)
        finally:
            worker.shutdown(cancel_futures=True)
