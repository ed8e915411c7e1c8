"""How the tests work the player, and see its pictures and texts."""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from typing import Any

import imagecodecs
import numpy as np
from numpy.typing import NDArray

from tests.web.conftest import Site

FILM = "film-sound.gsvr"

#: GOP, frame in it, tau, weight of the next GOP.
Moment = tuple[int, int, float, float]


def until(found: Callable[[], Any], seconds: float = 60) -> Any:
    """Wait until something is found, and return it."""
    end = time.monotonic() + seconds
    while not (value := found()):
        assert time.monotonic() < end, "it did not come"
        time.sleep(0.02)
    return value


def moment(page: Any) -> Moment:
    """Return the moment that is drawn; (-1, -1, 0, 0) = nothing is drawn."""
    # A page that is just being opened may have no picture yet.
    text = page.evaluate("document.getElementById('picture')?.dataset.moment ?? '-1 -1 0 0'")
    index, frame, tau, weight = text.split()
    return int(index), int(frame), float(tau), float(weight)


def shows(page: Any, place: tuple[int, int]) -> Any:
    """Wait until a frame, the second number, of a GOP, the first, is drawn."""
    return until(lambda: moment(page)[:2] == place)


def opened(page: Any, site: Site, name: str) -> Any:
    """Open a film and wait for its first picture."""
    page.goto(site.player(name))
    until(lambda: moment(page)[0] >= 0)
    return page


def moments_until(page: Any, done: Callable[[set[Moment]], bool]) -> set[Moment]:
    """Collect the moments that are drawn until `done` is true of them."""
    seen: set[Moment] = set()
    while not done(seen):
        seen.add(moment(page))
    return seen


def sentence(page: Any) -> str:
    """Wait for the sentence over the picture."""
    return str(until(lambda: page.locator("#sentence").text_content()))


def seek(page: Any, share: float) -> None:
    """Drag the slider of time to a share of the film."""
    page.locator("#seek").evaluate(
        """(slider, share) => {
            slider.value = slider.max * share;
            slider.dispatchEvent(new Event("input"));
        }""",
        share,
    )


def facts(page: Any) -> str:
    """The line below the controls."""
    return str(until(lambda: page.locator("#facts").text_content()))


def rendered_size(page: Any) -> tuple[int, int]:
    """The size at which the picture is rendered, when it rests."""
    width, height = re.findall(r"at (\d+)x(\d+)", facts(page))[0]
    return int(width), int(height)


def seconds_shown(page: Any) -> float:
    """The time that the player shows."""
    minutes, seconds = page.locator("#time").text_content().split(" / ")[0].split(":")
    return 60 * int(minutes) + float(seconds)


def at_rest(page: Any) -> NDArray[np.uint8]:
    """The picture as it is seen, when it is rendered at the size of the screen."""
    until(
        lambda: page.locator("#picture").evaluate(
            """(canvas) => {
                const { width, height } = canvas.getBoundingClientRect();
                return canvas.width === Math.round(width * devicePixelRatio)
                    && canvas.height === Math.round(height * devicePixelRatio);
            }"""
        )
    )
    shots = [b""]

    def rests() -> bool:  # a busy machine draws late
        page.wait_for_timeout(300)
        shots.append(page.locator("#picture").screenshot())
        return shots[-1] == shots[-2]

    until(rests)
    return np.asarray(imagecodecs.png_decode(shots[-1]))[:, :, :3]
