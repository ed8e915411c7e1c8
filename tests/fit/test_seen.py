"""Which Gaussians may reach into the frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gsvrcodec.fit.seen import seen
from gsvrcodec.model.gop import Gop
from gsvrcodec.render import render_frames
from tests import making

SIZE = (64, 48)


def white(position: list[tuple[float, float]], scale: float) -> Gop:
    """White Gaussians of so many pixels that stand still."""
    gop = making.random_gop(np.random.default_rng(0), gaussians=len(position))
    return replace(
        gop,
        position=np.array(position, np.float32),
        log_scale=np.full_like(gop.log_scale, np.log(scale)),
        colour=np.ones_like(gop.colour),
        indicator=np.ones_like(gop.indicator),
        linear=np.zeros_like(gop.linear),
        quadratic=np.zeros_like(gop.quadratic),
    )


def test_by_place_and_scale() -> None:
    places = [(0.0, 0.0), (1.1, 0.0), (1.9, 0.0), (0.0, -1.9), (-1.2, 1.2)]
    now = np.zeros(1, np.float32)
    assert seen(white(places, 2.0), now, SIZE).tolist() == [True, True, False, False, False]
    assert seen(white(places, 20.0), now, SIZE).all()


def test_none_that_is_drawn_is_missed() -> None:
    rng = np.random.default_rng(1)
    places = [(float(x), float(y)) for x, y in rng.uniform(-1.6, 1.6, (60, 2))]
    gop, now = white(places, 3.0), np.zeros(1, np.float32)
    for index, found in enumerate(seen(gop, now, SIZE)):
        one = white([places[index]], 3.0)
        drawn = render_frames(one, now, SIZE, SIZE).any()
        assert found or not drawn


def test_what_comes_in_is_seen() -> None:
    gop = white([(-1.5, 0.0), (-1.5, 0.0)], 2.0)
    gop.linear[1] = 0.6, 0.0
    taus = np.array([-1.0, 0.0, 1.0], np.float32)
    assert seen(gop, taus, SIZE).tolist() == [False, True]
