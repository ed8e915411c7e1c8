"""What a change of each parameter does to the picture."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from gsvrcodec.fit.precision import sensitivities, sensitivities_of_motion
from gsvrcodec.model.attributes import ATTRIBUTES
from gsvrcodec.model.gop import Float32Array, Gop
from gsvrcodec.model.static import append_gaussians, static_gop
from gsvrcodec.render.native import NativeBackend
from tests import making
from tests.fit.anchored import example
from tests.fit.synthetic import BACKEND, footage, times

SIZE = (96, 64)


def pictures(gop: Gop, taus: Float32Array) -> Float32Array:
    """Return unclamped frames, 255 = white."""
    prepared = BACKEND.prepare(gop)
    return np.stack([255 * BACKEND.picture(prepared, float(tau), SIZE, SIZE) for tau in taus])


def measured(gop: Gop, frames: int = 3, seed: int = 0, threads: int = 0) -> Gop:
    shots = footage(np.zeros((frames, SIZE[1], SIZE[0], 3), np.uint8))
    return sensitivities(shots, gop, np.random.default_rng(seed), NativeBackend(threads))


def covering() -> Gop:
    """One grey Gaussian that covers the frame."""
    none, grey = np.zeros(1, np.float32), np.full((1, 3), 0.5, np.float32)
    return static_gop(
        np.zeros((1, 2), np.float32), np.full((1, 2), 8, np.float32), none, grey, none
    )


@pytest.fixture(scope="module")
def gop() -> Gop:
    return making.random_gop(np.random.default_rng(5), gaussians=150)


@pytest.mark.parametrize("name", ["position", "log_scale", "xy"])
def test_foresees_the_error_of_noise(gop: Gop, name: str) -> None:
    taus, rng = times(5), np.random.default_rng(1)
    draws = [measured(gop, 5, seed) for seed in range(8)]
    foreseen = float(np.mean([getattr(d, name).sum(dtype=np.float64) for d in draws]))
    values, seen, size = getattr(gop, name), [], math.sqrt(100 / foreseen)
    for _ in range(8):
        sign = (2 * rng.integers(0, 2, values.shape) - 1).astype(np.float32)
        moved = replace(gop, **{name: values + np.float32(size) * sign})
        error = np.square(pictures(moved, taus) - pictures(gop, taus)).sum() / 3
        seen.append(float(error) / size**2)
    assert np.mean(seen) == pytest.approx(foreseen, rel=0.35)


def test_what_does_nothing_counts_nothing(gop: Gop) -> None:
    black = replace(gop, colour=np.zeros_like(gop.colour), xy=np.zeros_like(gop.xy))
    found = measured(black)
    assert not found.position.any()
    assert found.colour.any()


def test_threads_do_not_matter(gop: Gop) -> None:
    one, two = (measured(gop, threads=threads) for threads in (1, 2))
    for attribute in ATTRIBUTES:
        np.testing.assert_array_equal(getattr(one, attribute.name), getattr(two, attribute.name))


def test_of_what_an_anchor_makes_relative() -> None:
    """The motion of a carried Gaussian moves its position too; that of a new one does not."""
    _, anchor, stored = example()
    # Where nothing is behind, the edge of a Gaussian is a cliff, and no small change is small.
    behind = covering()
    shots = footage(np.zeros((3, SIZE[1], SIZE[0], 3), np.uint8), behind)
    drawn = anchor.gop(stored)
    plain = sensitivities(shots, drawn, np.random.default_rng(0), BACKEND)
    found, in_place = sensitivities_of_motion(
        shots, drawn, np.random.default_rng(0), BACKEND, anchor
    )
    for name in Gop.__slots__:
        np.testing.assert_array_equal(getattr(in_place, name), getattr(plain, name))
    for name in {*Gop.__slots__} - {"linear", "quadratic"}:
        np.testing.assert_array_equal(getattr(found, name), getattr(plain, name))
    new = ~anchor.carried
    np.testing.assert_array_equal(found.linear[new], plain.linear[new])

    def seen(name: str) -> float:
        """Squared error of random changes of the motion of carried Gaussians, by one."""
        errors, size = [], 0.02
        for seed in range(6):
            draw = np.random.default_rng(seed)
            values = getattr(stored, name)
            sign = (2 * draw.integers(0, 2, values.shape) - 1) * anchor.carried[:, None]
            moved = replace(stored, **{name: (values + size * sign).astype(np.float32)})
            now, before = (
                pictures(append_gaussians(one, behind), times(3))
                for one in (anchor.gop(moved), drawn)
            )
            apart = now - before
            errors.append(np.square(apart).sum() / 3 / size**2)
        return float(np.mean(errors))

    for name in ("linear", "quadratic"):
        foreseen = float(getattr(found, name)[anchor.carried].sum(dtype=np.float64))
        assert seen(name) == pytest.approx(foreseen, rel=0.5)
        assert foreseen > 2 * float(getattr(plain, name)[anchor.carried].sum(dtype=np.float64))
