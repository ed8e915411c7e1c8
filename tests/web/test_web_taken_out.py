"""Things that a person takes out of a film: what lies behind them shows."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.web.conftest import Site
from tests.web.driving import at_rest, facts, opened, seek, shows, until
from tests.web.films import FLIGHT_FRAMES, FLIGHT_SIZE, flight

pytestmark = pytest.mark.slow

#: Where the discs are in the third frame, and where nothing moves, pixels.
WHITE, RED, GROUND = (25, 27), (127, 57), (80, 80)
#: Times in frames: in the key GOP, on the way to the predicted one, in that, in the next key GOP.
TIMES = (2, FLIGHT_FRAMES - 0.5, FLIGHT_FRAMES + 3, 2 * FLIGHT_FRAMES + 3)


@pytest.fixture
def plain(page: Any, site: Site) -> list[NDArray[np.int_]]:
    """Pictures at all times of the film that has no white disc."""
    (site.films / "flight.gsvr").write_bytes(flight(with_disc=True))
    (site.films / "flight-red.gsvr").write_bytes(flight(with_disc=False))
    start(page, site, "flight-red.gsvr")
    return [picture(page, time) for time in TIMES]


def start(page: Any, site: Site, name: str) -> None:
    """Open a film, with pictures between frames."""
    opened(page, site, name)
    page.locator("#between").select_option("always")


def picture(page: Any, time: float) -> NDArray[np.int_]:
    """The picture at a time, counted in frames."""
    seek(page, time / (3 * FLIGHT_FRAMES))
    shows(page, divmod(int(time), FLIGHT_FRAMES))
    return at_rest(page).astype(int)


def tap(page: Any, place: tuple[int, int]) -> None:
    """Tap a place, pixels of the film, in a picture that fills what it can."""
    box = page.locator("#picture").bounding_box()
    middle = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    scale = min(box["width"] / FLIGHT_SIZE[0], box["height"] / FLIGHT_SIZE[1])
    x, y = (
        centre + (at - side / 2) * scale
        for centre, at, side in zip(middle, place, FLIGHT_SIZE, strict=True)
    )
    page.mouse.click(x, y)


def most(found: NDArray[np.int_], wanted: NDArray[np.int_]) -> int:
    """The largest difference of two pictures, codes."""
    return int(np.abs(found - wanted).max())


def comes_to(page: Any, time: float, wanted: NDArray[np.int_], apart: int) -> None:
    """Wait until the picture at a time is as wanted: what is taken out is searched in each GOP."""
    picture(page, time)
    until(lambda: most(at_rest(page).astype(int), wanted) <= apart)


def test_the_ground_shows_in_all_gops(page: Any, site: Site, plain: list[NDArray[np.int_]]) -> None:
    start(page, site, "flight.gsvr")
    before = [picture(page, time) for time in TIMES]
    assert min(most(*pair) for pair in zip(before, plain, strict=True)) > 100
    picture(page, TIMES[0])
    page.keyboard.press("x")
    tap(page, WHITE)
    until(lambda: "12 taken out" in facts(page))
    order = (*range(len(TIMES)), *reversed(range(len(TIMES))))
    for n in order:
        comes_to(page, TIMES[n], plain[n], 1)
    page.keyboard.press("Escape")
    until(lambda: most(at_rest(page).astype(int), before[0]) == 0)
    for n in order:
        comes_to(page, TIMES[n], before[n], 0)


def test_what_was_not_tapped_stays(page: Any, site: Site, plain: list[NDArray[np.int_]]) -> None:
    start(page, site, "flight.gsvr")
    before = picture(page, TIMES[0])
    page.locator("#remove").click()
    tap(page, GROUND)
    until(lambda: "nothing moves there" in facts(page))
    assert most(picture(page, TIMES[0]), before) == 0
    assert page.locator("#play").get_attribute("aria-label") == "Play"
    tap(page, RED)
    until(lambda: "12 taken out" in facts(page))
    changed = np.abs(picture(page, TIMES[0]) - before).max(axis=(0, 2))
    # The white disc is on the left, the red one on the right.
    half = len(changed) // 2
    assert changed[half:].max() > 100
    assert changed[:half].max() == 0
    tap(page, WHITE)
    until(lambda: most(at_rest(page).astype(int)[:, :half], plain[0][:, :half]) <= 1)
    page.locator("#remove").click()
    until(lambda: most(at_rest(page).astype(int), before) == 0)
